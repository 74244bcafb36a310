// Questions of a session: the state that the server tells is shown, one answer to each is said. experiment.py has the messages.

import { Field } from "./field.js";
import { palette } from "./plots.js";

const VERSION = 1;
const GUARD = 250; // ms in which a new question takes nothing: the second half of a double click was for the one before
const SILENT = 1500, DEAD = 5000, GONE = 30000; // ms without a word of the server: it is said; another connection; no more of them
const OFTEN = 100; // pictures after which the server is told of them
const MOST = 100, PAD = 24; // the end of a line; px beyond both ends, so that a finger reaches them
const $ = id => document.getElementById(id);
let texts = {}, ws = null, state = null, open = false, sent = false, final = false, begun = 0, frame = 0, late = 0;
let heard = performance.now(), away = null, back = 0, mark = null, drawn = ""; // since when there is no connection, and is one again
let pointer = ""; // where it is on the screen

const say = (key, values = {}) => (texts[key] ?? "..").replace(/\{(\w+)\}/g, (_, name) => values[name]);
const element = (parent, tag, more = {}) => Object.assign(parent.appendChild(document.createElement(tag)), more);
const words = (text, kind = "") => { $("state").textContent = text; $("state").className = kind; };
const show = (id, wanted) => { $(id).hidden = !wanted; };

/** The picture of a stimulus; tests and benchmarks read it. */
export const field = new Field($("picture"), message => { if (open && drawing?.sources) ws.send(JSON.stringify(message)); }, true);
let drawing = null, colours = palette(), values = null, newest = null, samples = []; // newest: sample that is drawn next; those that were drawn

// What is asked ---------------------------------------------------------------------------------------------------------------------
function become(now) {
  const fresh = now.number !== state?.number;
  state = now;
  sent = false;
  clearTimeout(late);
  begun = performance.now() - 1000 * now.since;
  $("trial").textContent = now.trial === now.text ? "" : now.trial;
  $("told").replaceChildren();
  for (const textContent of now.phase === "end" ? now.told.slice(0, -1) : now.told) element($("told"), "p", { textContent });
  if (fresh) ask(now);
  heading();
  if (now.drawing?.number !== drawing?.number) draw(now.drawing);
  enable(); // or it takes no focus
  const first = now.kind === "analogue" ? "vas" : now.line && (now.kind !== "rating" || !now.keys.length) ? "typed" : "text";
  if (fresh && now.phase !== "wait") $(first).focus({ preventScroll: true });
  show("clock", now.phase === "rest" || now.intervals?.length);
  show("track", now.cursor);
  words(say("connected"), "good");
  tick();
  report();
}

/** What is asked, or goes on; without a connection nothing does. */
function heading() {
  const { phase, text, told } = state, gone = phase === "feel" && !open;
  const now = gone ? say("wait") : text ?? (phase === "end" ? told.at(-1) ?? "" : say(phase));
  document.body.classList.toggle("away", gone);
  if ($("text").textContent !== now) $("text").textContent = now;
}

function ask({ kind, line, keys = [], apart = [], ends = [], hint = "", words: names = [] }) {
  const scale = kind === "rating" && keys.length, analogue = kind === "analogue", row = scale || analogue;
  document.body.classList.add("still"); // until the pointer moves, see ask.css
  $("hint").textContent = analogue ? say("touch_line") : hint;
  $("answers").className = row ? "scale" : "options";
  for (const id of ["keys", "apart", "words"]) $(id).replaceChildren();
  for (const [key, says] of keys) {
    const made = button("keys", key, scale ? "" : says);
    if (scale && says) made.ariaLabel = `${key}: ${says}`;
  }
  const longest = Math.max(0, ...[...keys.map(([, says]) => says), ...names].flatMap(says => says.split(/\s+/)).map(word => word.length));
  for (const id of ["keys", "words"]) $(id).style.setProperty("--least", `${Math.max(6, 0.6 * longest + 1.3)}em`); // no word is cut
  $("keys").style.setProperty("--n", keys.length);
  for (const [key, says] of apart) button("apart", key, says);
  for (const word of names) Object.assign(button("words", "", word), { onclick: () => take(word) }).dataset.key = word;
  for (const [id, k] of [["low", 0], ["high", 1]]) $(id).textContent = row ? ends[k] : "";
  $("typed").inputMode = kind === "rating" ? "numeric" : "text";
  type("");
  put(null);
  for (const [id, wanted] of [["hint", hint], ["words", names.length], ["vas", analogue], ["keys", keys.length], ["low", row], ["high", row],
    ["asked", line && !analogue], ["does", line], ["clear", names.length], ["apart", apart.length]]) show(id, wanted);
}

/** What is drawn from now on, or null. */
function draw(now = null) {
  tell();
  [drawing, values, newest] = [now, null, null];
  show("picture", drawing);
  if (!drawing) return;
  const driven = drawing.sources !== null;
  Object.assign($("picture"), { role: driven ? "application" : "img", tabIndex: driven ? 0 : -1 });
  $("picture").style.cursor = driven && drawing.cursor ? "none" : "";
  field.set({ view: drawing.views[0], sources: drawing.sources ?? {}, parts: drawing, beside: drawing.beside });
  if (driven) field.again();
  $("picture").scrollIntoView({ block: "nearest" });
}

/** The newest sample of a stimulus: number of the drawing, sample, interval or -1, values of its view. */
function see([number, sample, k, ...all]) {
  if (number !== drawing?.number) return;
  const view = drawing.views[Math.max(0, k)];
  if (view !== field.view) field.set({ view });
  values = k < 0 ? null : Object.fromEntries((view?.values ?? []).map((name, i) => [name, all[i]]));
  newest = k < 0 ? null : sample;
  field.dirty = true;
}

/** Says which samples were drawn, for the log. */
function tell() {
  if (!samples.length || !open) return;
  const { left, top, width, height } = $("picture").getBoundingClientRect();
  ws.send(JSON.stringify({ do: "pictures", number: drawing.number, wide: innerWidth, high: innerHeight, box: [left, top, width, height], samples }));
  samples = [];
}

function button(parent, key, says) {
  const made = element($(parent), "button", { type: "button", onclick: () => answer(key) });
  made.dataset.key = key || "any";
  const any = [["kbd", says], ["span", say("any_key")]], shown = key ? [["kbd", key], ["span", says]] : parent === "keys" ? any : [["span", says]];
  for (const [tag, textContent] of shown) if (textContent) element(made, tag, { textContent });
  return made;
}

/** The line that is typed; a word that is in it cannot come again. */
function type(text) {
  $("typed").value = text.trim();
  enable();
}

function take(word) {
  type(`${$("typed").value} ${word}`);
  (document.querySelector("#words button:enabled") ?? $("enter")).focus();
}

/** The mark on the line: null before there is one. */
function put(value) {
  mark = value === null ? null : Math.min(MOST, Math.max(0, Math.round(10 * value) / 10));
  show("mark", mark !== null);
  $("vas").ariaValueNow = mark ?? MOST / 2; // which a slider must have
  $("vas").ariaValueText = mark ?? say("unmarked");
  $("mark").style.left = `calc(${PAD}px + (100% - ${2 * PAD}px) * ${(mark ?? 0) / MOST})`;
  enable();
}

function answer(text) {
  if (!open || sent || state?.phase !== "ask" || performance.now() - Math.max(begun, back) < GUARD) return;
  sent = true;
  ws.send(JSON.stringify({ do: "answer", number: state.number, text }));
  late = setTimeout(() => { if (open) words(say("sent")); }, 1500);
  enable();
}

function enable() {
  const used = $("typed").value.split(/\s+/), unmarked = state?.kind === "analogue" && mark === null;
  for (const b of document.querySelectorAll("main :is(button, input)"))
    b.disabled = !open || sent || (b.parentElement.id === "words" && used.includes(b.dataset.key)) || (b.id === "enter" && unmarked);
}

/** What moves: seconds that are left of a rest, which interval it is, the reference. */
function tick() {
  const t = (performance.now() - begun) / 1000;
  if (state.phase === "rest") {
    const left = Math.max(0, Math.ceil(state.seconds - t));
    $("clock").textContent = `${Math.floor(left / 60)}:${String(left % 60).padStart(2, "0")}`;
  } else if (state.intervals?.length) { // of a self-paced one, while it is asked for its end
    const all = state.intervals, k = all.findIndex(([a, b]) => a <= t && t < b);
    $("clock").textContent = k < 0 ? "" : all.length > 1 ? say("interval", { number: k + 1, total: all.length }) : say("now");
    const y = k < 0 || !state.cursor ? 0 : Math.sin(2 * Math.PI * state.cursor * (t - all[k][0]));
    $("point").style.transform = `translateY(${-0.5 * y * ($("track").clientHeight - $("point").clientHeight)}px)`;
  } else if (!drawing) return;
  if (drawing && field.refresh(performance.now(), colours, values) && newest !== null && samples.push(newest) >= OFTEN) tell();
  cancelAnimationFrame(frame);
  frame = requestAnimationFrame(tick);
}

/** Says how a question is drawn, for the log. */
function report() {
  if (!open || sent || state?.phase !== "ask") return;
  const all = [...document.querySelectorAll("main [data-key]")].filter(e => e.checkVisibility());
  const boxes = all.map(e => [e.dataset.key, ...(r => [r.left, r.top, r.width, r.height].map(v => Math.round(10 * v) / 10))(e.getBoundingClientRect())]);
  const now = JSON.stringify({ do: "drawn", number: state.number, wide: innerWidth, high: innerHeight, boxes: boxes.slice(0, 64) });
  if (now !== drawn) ws.send(drawn = now);
}

// The connection --------------------------------------------------------------------------------------------------------------------
function connect() {
  const mine = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
  ws?.close();
  ws = mine;
  [heard, open, final, drawn] = [performance.now(), false, false, ""];
  mine.binaryType = "arraybuffer";
  mine.onopen = () => mine.send(JSON.stringify({ do: "hello", token: location.hash.slice(1), version: VERSION }));
  mine.onmessage = ({ data }) => {
    if (mine !== ws) return;
    if (typeof data === "string") hear(JSON.parse(data)); else see(new Float64Array(data));
  };
  mine.onclose = ({ code, reason }) => { if (mine === ws) lose(code, reason); };
  show("retry", false);
}

function hear(m) {
  heard = performance.now();
  if (m.is === "hello") {
    texts = m.texts;
    document.documentElement.lang = texts.language;
    for (const [id, key] of [["name", "your_answer"], ["enter", "answer"], ["clear", "clear"]]) $(id).textContent = say(key);
    $("track").ariaLabel = say("follow");
    $("picture").ariaLabel = say("picture");
  }
  if (!open) {
    [open, away, back] = [true, null, performance.now()];
    words(say("connected"), "good");
    field.again(); // says what was done meanwhile
  }
  if (m.is === "state") become(m);
  else if (m.about === "answer") sent = false;
  enable();
}

/** The connection is lost, or is silent; 44..: for good, but for a page that was too slow. */
function lose(code = 0, why = "") {
  open = false;
  away ??= performance.now();
  final = code >= 4400 && ![4408, 4429].includes(code);
  const key = { 4410: "over", 4409: "elsewhere" }[code] ?? (final ? "refused" : gone() ? "gone" : "lost");
  words(texts[key] ?? `.. ${why}`, key === "over" ? "" : "bad"); // a page that was never let in has no texts: the experimenter reads why
  show("retry", ["gone", "elsewhere"].includes(key));
  $("retry").textContent = say(key === "elsewhere" ? "use" : "retry");
  if (state) heading();
  if (code && !final) setTimeout(() => { if (ws.readyState > 1 && !gone()) connect(); }, 500);
  enable();
}

const gone = () => final || (away !== null && performance.now() - away > GONE);

/** The page's own watch: a server or network that is frozen closes nothing. */
function watch() {
  const silent = performance.now() - heard;
  if (final) return;
  if (open && silent > SILENT) lose();
  else if (gone() && $("retry").hidden) { ws.close(); lose(); }
  else if (!open && !gone() && silent > DEAD) connect();
}

const again = () => { away = performance.now(); connect(); };
connect();
setInterval(watch, 250);
addEventListener("hashchange", () => { if (state) state.number = null; draw(); again(); }); // another session, with the same numbers
for (const back of ["online", "visibilitychange"]) addEventListener(back, () => { if (!open && !final) again(); });
addEventListener("resize", report);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colours = palette(); field.dirty = true; });
$("retry").onclick = again;

// Keys and pointers -----------------------------------------------------------------------------------------------------------------
const STEPS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10, Home: -1e9, End: 1e9 };
const drag = e => {
  const { left, width } = $("vas").getBoundingClientRect();
  if (e.buttons && open && !sent) put(MOST * (e.clientX - left - PAD) / (width - 2 * PAD));
};
$("vas").onpointerdown = e => { $("vas").setPointerCapture(e.pointerId); drag(e); };
$("vas").onpointermove = drag;
$("clear").onclick = () => { type(""); $("typed").focus(); };
$("typed").oninput = enable;
$("line").onsubmit = e => {
  e.preventDefault();
  const text = state?.kind === "analogue" ? String(mark ?? "") : $("typed").value;
  if (text.trim()) answer(text);
};
addEventListener("pointermove", ({ pointerType, screenX, screenY }) => { // which browsers send after a click, too, without a way
  const now = `${screenX} ${screenY}`;
  if (pointerType !== "touch" && pointer !== now) document.body.classList.toggle("still", pointer === "");
  pointer = now;
});
addEventListener("keyup", e => field.key(e, false));
addEventListener("keydown", e => {
  if (e.ctrlKey || e.metaKey || e.altKey || e.isComposing || e.target.matches?.("input")) return;
  const moves = drawing?.sources && (state.phase === "feel" || (e.key in STEPS && state.kind !== "analogue")); // not what answers
  if (moves && field.key(e, true)) return e.preventDefault();
  if (e.target.matches?.("button") && ["Enter", " "].includes(e.key)) { if (e.repeat) e.preventDefault(); return; } // it clicks
  const analogue = state?.kind === "analogue" && open && !sent;
  const keys = [...(state?.keys ?? []), ...(state?.apart ?? [])].map(([key]) => key);
  const any = keys.includes("") && (e.key.length === 1 || e.key === "Enter");
  const key = [e.key, e.key.toLowerCase()].find(k => keys.includes(k)) ?? (any ? "" : null);
  if (analogue && e.key in STEPS) put(Math.abs(STEPS[e.key]) > 1e6 || mark !== null ? (mark ?? 0) + STEPS[e.key] : MOST / 2);
  else if (analogue && e.key === "Enter") { if (!e.repeat) $("line").requestSubmit(); }
  else if (state?.line && e.key.length === 1 && /[\d.,;-]/.test(e.key)) return $("typed").focus(); // which takes it
  else if (key === null) return;
  else if (!e.repeat) answer(key);
  e.preventDefault();
});
