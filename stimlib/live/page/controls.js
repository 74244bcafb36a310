// What is set by hand: parameters, and what drives each input. Each builder gets a function that says it to the server.

import { write } from "./about.js";
import { pretty } from "./scales.js";

const element = (parent, tag, more = {}) => Object.assign(parent.appendChild(document.createElement(tag)), more);

function numeric(parent, id, value, low, high) {
  const field = element(parent, "input", { className: "number", inputMode: "decimal", id, value: `${value}` }); // type number may make 05 of 0,5
  if (low !== undefined) Object.assign(field, { min: `${low}`, max: `${high}` });
  return field;
}

/** Why what is typed is not taken; the focus stays where it is, as the next key may stop the stimulus. */
function mark(field, why) {
  field.setCustomValidity(why);
  field.title = why;
}

/** What is typed, inside its limits, a comma for a point, too; null where it is no number, or 1,250, which may be either of two. */
function typed(field) {
  const text = field.value.trim(), v = /^[+-]?[1-9]\d{0,2},\d{3}$/.test(text) ? NaN : +(text.replace(",", ".") || NaN);
  mark(field, Number.isFinite(v) ? "" : "This is no number; type one such as 0.5");
  if (field.title) return null;
  const low = field.min === "" ? -Infinity : +field.min, high = field.max === "" ? Infinity : +field.max;
  return Math.min(high, Math.max(low, v));
}

const plain = v => `${+v.toPrecision(6)}`;
const put = (field, v) => { field.value = plain(v); mark(field, ""); };

/** A slider, a number and a reset for each of hello's params. Returns a function that shows values {name: value}. */
export function parameters(params, parent, say) {
  const show = {};
  parent.replaceChildren();
  for (const { name, unit, value, low, high, meaning } of params) {
    const row = element(parent, "div", { className: "param" }), id = `param-${name}`, printed = pretty(unit);
    element(row, "label", { htmlFor: id, textContent: name });
    const field = numeric(row, id, plain(value), low, high);
    field.setAttribute("aria-label", `${name}, parameter`); // the page has facts of the same names
    element(row, "span", { className: "unit", textContent: printed });
    const reset = element(row, "button", { type: "button", textContent: "↺", title: `Back to ${plain(value)} ${printed}` });
    reset.setAttribute("aria-label", `Reset ${name} to ${plain(value)} ${printed}`);
    const range = { min: `${low}`, max: `${high}`, step: `${(high - low) / 1000}`, value: `${value}` };
    const slider = element(row, "input", { type: "range", ...range });
    slider.setAttribute("aria-label", `${name}, slider`);
    const said = [meaning, unit === "1" && "No unit."].filter(Boolean).join(" ");
    if (said) write(element(row, "p", { className: "hint" }), said, false);
    show[name] = v => {
      if (document.activeElement !== field) put(field, v);
      if (document.activeElement !== slider) slider.value = `${v}`;
      slider.setAttribute("aria-valuetext", `${plain(v)} ${printed}`);
    };
    const set = v => { say({ do: "set", name, value: v }); put(field, v); slider.value = `${v}`; show[name](v); };
    slider.oninput = () => set(+slider.value);
    field.onchange = () => { const v = typed(field); if (v !== null) set(v); };
    reset.onclick = () => set(value);
    show[name](value);
  }
  return values => { for (const [name, v] of Object.entries(values)) show[name]?.(v); };
}

export const FROM = {
  u: "pointer, left to right", v: "pointer, bottom to top", pressure: "pressure", contact: "contact, 0 or 1",
  sine: "a sine", value: "a value that is held", given: "the motion that was given",
  stream: "the stream of another program",
};
const FIELDS = { // what each kind asks for
  u: ["finger", "low", "high"], v: ["finger", "low", "high"], pressure: ["finger", "low", "high"], contact: ["finger"],
  sine: ["low", "high", "freq"], value: ["value"], given: [],
  stream: ["channel", "scale", "low", "high"],
};
const LABELS = { low: "from", high: "to", freq: "frequency / Hz", value: "value", finger: "finger", channel: "number of a row", scale: "times" };

/** A choice of what drives each of hello's inputs. Returns a function that shows state's sources. */
export function sources({ inputs, stream }, parent, say) {
  const show = {};
  parent.replaceChildren();
  for (const { name, unit, given } of inputs) {
    const set = element(parent, "fieldset"), printed = pretty(unit);
    element(set, "legend", { textContent: name });
    const from = element(set, "select");
    from.setAttribute("aria-label", `What drives ${name}`);
    for (const [value, textContent] of Object.entries(FROM))
      if ((value !== "given" || given) && (value !== "stream" || stream)) element(from, "option", { value, textContent });
    const box = element(set, "div", { className: "numbers" });
    let now = {};
    const rows = () => {
      box.replaceChildren();
      for (const key of FIELDS[from.value] ?? []) {
        const id = `source-${name}-${key}`, inUnit = ["low", "high", "value"].includes(key) && printed;
        const label = element(box, "label", { htmlFor: id, textContent: LABELS[key] + (inUnit ? ` / ${printed}` : "") });
        const field = key === "finger" ? element(label, "select", { id }) : numeric(label, id, plain(now[key] ?? 0));
        if (key === "freq") Object.assign(field, { min: "0.01", max: "1000" });
        if (key === "channel") Object.assign(field, { min: "0", max: "999", step: "1" });
        if (key === "finger") {
          for (let k = 0; k < 5; k++) element(field, "option", { value: `${k}`, textContent: `${k + 1}` });
          field.value = `${now.finger ?? 0}`;
        }
        field.setAttribute("aria-label", `${name}: ${label.firstChild.textContent}`);
        field.onchange = () => {
          const v = key === "finger" ? +field.value : typed(field);
          if (v !== null) say({ do: "source", input: name, from: from.value, [key]: v });
        };
      }
    };
    from.onchange = () => { say({ do: "source", input: name, from: from.value }); rows(); };
    show[name] = source => {
      const same = JSON.stringify(source) === JSON.stringify(now);
      now = source;
      if (same || box.contains(document.activeElement)) return;
      from.value = source.from;
      rows();
    };
  }
  return values => { for (const [name, source] of Object.entries(values)) show[name]?.(source); };
}

/** In words, what the axes of the field mean: {u: [...], v: [...]}, each {input, low, high, finger}. */
export function axes(all) {
  const out = { u: [], v: [] };
  for (const [input, s] of Object.entries(all)) out[s.from]?.push({ input, ...s });
  return out;
}
