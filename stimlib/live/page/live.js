// The page: what comes from the server is shown, what is done by hand is said to it. protocol.py has the messages.

import { parameters, sources } from "./controls.js";
import { Field } from "./field.js";
import { History, Panel, Spectrum, grouped, palette } from "./plots.js";
import { pretty, short } from "./scales.js";
import { Sound } from "./sound.js";

const HEAD = 6, LONGEST = 10, QUIET = -60; // float64 ahead of the samples, s that are kept, dB below which nothing is shown
const WORDS = { idle: "stopped", starting: "fading in", running: "running", stopping: "fading out" };
const $ = id => document.getElementById(id), clock = () => performance.timeOrigin + performance.now();
const calm = matchMedia("(prefers-reduced-motion: reduce)");

const link = new Worker("link.js"), sound = new Sound(link);
const say = message => link.postMessage(message);

/** What the page knows; tests and benchmarks read it. */
export const live = {
  hello: null, state: null, report: null, history: null, sound, field: null, panels: [], outputs: {}, blocks: 0,
  drawn: [], pictures: 0, // ms from the pointer to the picture; pictures of the curves
};
let colours = palette(), show = {}, heard = 0, log = "", peak = 0, clips = 0;
let level = -1, clipped = -1e9, told = 0, shown = -1, marks = [], last = 0; // when, and for which samples

const touch = message => { if (live.state?.role === "control") say(message); }; // who watches moves nothing
const field = live.field = new Field($("field"), touch);
const spectrum = new Spectrum($("spectrum"), null);

// From the server -----------------------------------------------------------------------------------------------------
function words(text, kind) {
  $("state").textContent = text;
  $("state").className = kind;
}

function note(text) {
  $("note").hidden = !text;
  $("note").textContent = text ?? "";
}

function greet(hello) {
  const same = JSON.stringify(hello) === JSON.stringify(live.hello);
  if (same) return;
  const all = [...hello.inputs, ...hello.outputs].map((s, index) => ({ ...s, index }));
  const inputs = all.slice(0, hello.inputs.length), outputs = all.slice(inputs.length);
  live.hello = hello;
  live.history = spectrum.history = new History(Math.ceil(LONGEST * hello.fs), all.map(s => s.full ?? 1));
  $("title").textContent = document.title = hello.title;
  for (const parent of ["inputs", "outputs"]) $(parent).replaceChildren();
  const drawnIn = (signals, where) => grouped(signals).map(g => new Panel(g, live.history, $(where)));
  live.panels = [...drawnIn(inputs, "inputs"), ...drawnIn(outputs, "outputs")];
  show = { params: parameters(hello.params, $("params"), say), sources: sources(hello, $("sources"), say) };
  $("mark").hidden = !hello.marks;
  $("no-params").hidden = hello.params.length > 0;
  $("heard").replaceChildren(...outputs.map(({ name }, k) => new Option(name, k)));
  field.set({ view: hello.view, units: Object.fromEntries(inputs.map(i => [i.name, i.unit])) });
  $("map-choice").hidden = !hello.view;
  hear(Math.max(0, outputs.findIndex(o => !/^[xy]\d?$|^depth/.test(o.name))));
}

function become(state) {
  const before = live.state, mine = state.role === "control", runs = state.phase === "running" || state.phase === "starting";
  live.state = state;
  const more = (state.log ? ", recording" : "") + (mine ? "" : "; another page controls, this one watches");
  words(`Connected, ${WORDS[state.phase]}${more}`, runs ? "good" : "");
  if (before?.session !== state.session) field.again();
  $("run").textContent = runs ? "Stop" : "Start";
  $("record").textContent = state.log && runs ? "Stop recording" : "Record";
  $("record").setAttribute("aria-pressed", String(!!state.log && runs));
  for (const id of ["run", "record"]) $(id).disabled = !mine || state.phase === "stopping";
  $("mark").disabled = !mine || state.phase !== "running";
  $("control").hidden = mine;
  for (const control of document.querySelectorAll(".side input, .side select, .side button")) // a page that watches may listen
    if (!control.closest("[aria-labelledby=h-sound]")) control.disabled = !mine;
  show.params?.(state.params);
  show.sources?.(state.sources);
  field.set({ sources: state.sources });
  log = state.log ?? log;
  $("log").textContent = log && `${state.log && runs ? "Recording to" : "Recorded in"} ${log}`;
  note(state.why);
}

function lost({ state, code, why }) {
  const more = code === 4401 ? "" : "; load this page again to retry";
  words(state === "refused" ? `Refused: ${why}${more}` : "Connection lost, trying again", "bad");
  for (const id of ["run", "record", "mark"]) $(id).disabled = true;
}

function count(report) {
  live.report = report;
  const all = Object.values(report.clips).flatMap(Object.values).reduce((a, b) => a + b, 0);
  if (all > clips) clipped = performance.now();
  clips = all;
  $("clock").textContent = `${report.seconds.toFixed(1)} s`;
  $("underruns").textContent = report.underruns;
  const broken = Object.keys(report.faults);
  if (broken.length) note(`Not finite: ${broken.join(", ")}. The session was faded out.`);
}

function take(data) {
  const head = new Float64Array(data, 0, HEAD), n = head[5], all = new Float32Array(data, 8 * HEAD), { hello, history } = live;
  if (!hello || !n) return;
  const of = hello.inputs.length;
  for (let k = (of + heard) * n; k < (of + heard + 1) * n; k++) peak = Math.max(peak, Math.abs(all[k]));
  history.push(head[0], n, all);
  hello.outputs.forEach(({ name }, i) => { live.outputs[name] = history.newest(of + i); });
  live.blocks++;
  field.dirty = field.dirty || !!hello.view;
  if (head[1] && head[1] !== last && marks.length < 64) marks.push(last = head[1]);
}

const SAID = { hello: greet, state: become, report: count, error: m => note(`${m.about}: ${m.text}`) };
link.onmessage = ({ data: m }) => {
  if (m.samples) take(m.samples);
  else if (m.text) SAID[m.text.is]?.(m.text);
  else if (m.state) { if (m.state !== "open") lost(m); }
  else sound.told(m);
};
say({ open: `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`, token: location.hash.slice(1) });

// By hand -------------------------------------------------------------------------------------------------------------
function hear(k) {
  const { hello } = live, { name, unit, full } = hello.outputs[k];
  heard = k;
  $("heard").value = k;
  $("spectrum-of").textContent = name;
  $("left-out").textContent = sound.hear(k, name, `${short(full)} ${pretty(unit)}`.trim());
}

const runs = () => ["running", "starting"].includes(live.state?.phase);
$("run").onclick = () => say({ do: runs() ? "stop" : "start" });
$("mark").onclick = () => say({ do: "mark" });
$("record").onclick = () => say({ do: runs() && live.state.log ? "stop" : "record" });
$("control").onclick = () => say({ do: "control" });
$("heard").onchange = e => hear(+e.target.value);
$("gain").oninput = e => { $("gain-is").textContent = `${e.target.value} dB`.replace("-", "−"); sound.loud(+e.target.value); };
$("map").onchange = e => { field.hard = e.target.checked; field.dirty = true; };
$("sound").onclick = async () => {
  try {
    const on = await sound.toggle();
    $("sound").setAttribute("aria-pressed", String(on));
    $("sound").textContent = on ? "Sound off" : "Sound on";
  } catch (e) { note(`No sound: ${e.message}`); }
};

const typing = e => e.target.matches?.("input, select, textarea") || e.ctrlKey || e.metaKey || e.altKey;
addEventListener("keydown", e => {
  if (typing(e)) return;
  const button = e.target.matches?.("button");
  if (e.key === " " && !button) { if (!e.repeat) $("run").click(); } 
  else if (e.key.toLowerCase() === "m") { if (!e.repeat) $("mark").click(); }
  else if (e.key.toLowerCase() === "r") { if (!e.repeat) $("record").click(); }
  else if ((button && e.key === "Enter") || live.state?.role !== "control" || !field.key(e, true)) return;
  e.preventDefault();
});
addEventListener("keyup", e => { field.key(e, false); });

function theme(name) {
  if (name === "auto") delete document.documentElement.dataset.theme; else document.documentElement.dataset.theme = name;
  $("theme").value = name;
  colours = palette();
  field.dirty = true;
}
function stored(name) {
  try { return name ? localStorage.setItem("theme", name) : localStorage.getItem("theme"); } catch { return null; }
}
$("theme").onchange = e => { theme(e.target.value); stored(e.target.value); }; // a frame in a notebook may have no storage
theme(stored() ?? "auto");
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => theme($("theme").value));

// Drawing -------------------------------------------------------------------------------------------------------------
function meter(seconds) {
  const db = Math.max(QUIET, 20 * Math.log10(peak + 1e-9));
  peak *= 10 ** (-seconds); // 20 dB in a second
  const bar = $("meter");
  const part = Math.round(200 * (1 - db / QUIET)) / 200;
  if (part !== level) {
    level = part;
    bar.firstElementChild.style.transform = `scaleX(${part})`;
    bar.classList.toggle("high", db > -3);
  }
  return db;
}

const median = all => all.slice().sort((a, b) => a - b)[all.length >> 1];
function lag() {
  if (!live.drawn.length) return "";
  const heardToo = sound.played.length ? `, to the sound card ${median(sound.played).toFixed(0)} ms` : "";
  const gaps = sound.figures ? ` Gaps in the sound: ${sound.figures.under}.` : "";
  return `From the pointer to the picture ${median(live.drawn).toFixed(0)} ms${heardToo} (medians).${gaps}`;
}

/** What is drawn with a frame, but takes at most a third of the time, on however slow a machine. */
class Turn {
  cost = 0; // ms
  last = 0;
  due(now, least) { return now - this.last >= Math.max(least, 3 * this.cost); }
  take(now, draw) {
    const begun = performance.now();
    draw();
    this.last = now;
    this.cost += 0.2 * (performance.now() - begun - this.cost);
  }
}

let before = 0;
const hand = new Turn(), curves = new Turn(), lines = new Turn();
function plot(now, telling) {
  const { fs, inputs, outputs } = live.hello;
  shown = live.history.end;
  live.pictures++;
  for (const p of live.panels) p.draw(fs, +$("window").value, colours, telling);
  if (spectrum.take(inputs.length + heard, fs) || lines.due(now, 250))
    lines.take(now, () => spectrum.draw(fs, outputs[heard].unit, colours));
  for (const t of marks) if (live.drawn.push(clock() - t) > 1000) live.drawn.shift();
  marks = [];
}

function tick(now) {
  requestAnimationFrame(tick);
  field.tick(now);
  if (field.dirty && hand.due(now, calm.matches && field.view ? 100 : 0)) {
    field.dirty = false;
    hand.take(now, () => field.draw(colours, live.outputs));
  }
  const db = meter(Math.min(0.2, (now - before) / 1000)), telling = now - told > 250;
  before = now;
  if (telling) {
    told = now;
    sound.ask();
    $("lag").textContent = lag();
    $("where").textContent = field.words();
    $("level").textContent = `${db.toFixed(0)} dB`.replace("-", "−");
    $("meter").setAttribute("aria-valuenow", db.toFixed(0));
    const on = now - clipped < 2000;
    if (on !== $("clip").classList.contains("on")) { // told once, as it is read aloud
      $("clip").classList.toggle("on", on);
      $("clip").textContent = on ? "clip" : "no clip";
    }
  }
  const fresh = live.history && (live.history.end !== shown || now - curves.last > 500); // or another size, theme or choice
  if (fresh && curves.due(now, calm.matches ? 250 : 0)) curves.take(now, () => plot(now, telling));
}
requestAnimationFrame(tick);
