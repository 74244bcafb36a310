// The page: what comes from the server is shown, what is done by hand is said to it. protocol.py has the messages.

import { introduce } from "./about.js";
import { connected } from "./connect.js";
import { parameters, sources } from "./controls.js";
import { Field } from "./field.js";
import { History, Panel, Spectrum, Turn, grouped, palette } from "./plots.js";
import { counted, scaled, short } from "./scales.js";
import { LEAST, Level } from "./sound.js";

const HEAD = 6, ENDED = 1012, LONGEST = 10, QUIET = -60; // float64 ahead of the samples, s that are kept, dB below which nothing is shown
const WORDS = { idle: "stopped", starting: "fading in", running: "running", stopping: "fading out" };
const $ = id => document.getElementById(id), clock = () => performance.timeOrigin + performance.now();
const calm = matchMedia("(prefers-reduced-motion: reduce)");

const { link, sound } = connected();
const say = message => link.postMessage(message);

/** What the page knows; tests and benchmarks read it. */
export const live = {
  hello: null, state: null, report: null, history: null, sound, field: null, panels: [], outputs: {}, blocks: 0,
  drawn: [], pictures: 0, // ms from the pointer to the picture; pictures of the curves
};
let colours = palette(), show = {}, heard = 0, level = null, clips = 0, away = true, silences = 0; // no server; how often it was silent
let hole = null, missing = 0, drawn = {}; // a silence that is not over yet; s that were not computed in all; the sample that is drawn
let part = -1, clipped = -1e9, told = 0, shown = -1, marks = [], last = 0; // when, and for which samples

const mine = () => !away && live.state?.role === "control", runs = () => ["running", "starting"].includes(live.state?.phase);
const touch = message => { if (mine()) say(message); }; // who watches moves nothing
const field = live.field = new Field($("field"), touch);
const spectrum = new Spectrum($("spectrum"), null);

// From the server -----------------------------------------------------------------------------------------------------
function words(text, kind) {
  if ($("state").textContent !== text) $("state").textContent = text; // it is read aloud
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
  live.history = spectrum.history = new History(Math.ceil(LONGEST * hello.fs), [...all, ...outputs].map(s => s.full ?? 1));
  $("title").textContent = document.title = hello.title;
  for (const parent of ["inputs", "outputs", "first"]) $(parent).replaceChildren();
  const drawnIn = (signals, where) => grouped(signals).map(g => new Panel(g, live.history, $(where)));
  const vibrates = o => drawnIn(!o.vibrates ? [] : [{ ...o, index: o.index + outputs.length, least: LEAST * o.full, whole: o.index }], "outputs");
  live.panels = [...drawnIn(inputs, "inputs"), ...grouped(outputs).flatMap(g => [...drawnIn(g, "outputs"), ...g.flatMap(vibrates)])];
  show = { params: parameters(hello.params, $("params"), say), sources: sources(hello, $("sources"), say) };
  for (const part of document.querySelectorAll("[data-of=inputs]")) part.hidden = !inputs.length;
  const [wait, smoothing] = (hello.behind ?? [0, 0]).map(s => Math.round(1e3 * s)); // the parts make the whole
  $("behind").textContent = `The stimulus follows a pointer ${wait + smoothing} ms later, so that no step of it vibrates: ${wait} ms until`
    + ` its next report has come, and ${smoothing} ms of smoothing.`;
  $("mark").hidden = $("marks").hidden = !hello.marks;
  introduce(hello);
  $("no-params").hidden = hello.params.length > 0;
  $("heard").replaceChildren(...outputs.map(({ name }, k) => new Option(name, k)));
  field.set({ view: hello.view, units: Object.fromEntries(inputs.map(i => [i.name, i.unit])) });
  $("map-of").textContent = hello.view?.hidden ? "Show where the bumps are" : "Show how soft each place is";
  $("map-choice").hidden = !(hello.view?.levels ?? hello.view?.hidden);
  const felt = [o => o.vibrates && !["V", "A"].includes(o.unit), o => !/^[xy]\d?$|^depth/.test(o.name), () => true]; // the first that holds
  hear(Math.max(0, outputs.findIndex(felt.find(is => outputs.some(is)))));
}

/** What the session does, and whether it has had any motion yet. */
function status() {
  const { state, report } = live, waits = runs() && report?.session === state.session && report.silent;
  const who = mine() ? "this page controls" : state.controlled ? "another page controls, this one watches" : "no page controls";
  if (live.hello.alone) words(WORDS[state.phase], runs() ? "good" : "");
  else words(`Connected, ${WORDS[state.phase]}${state.log ? ", recording" : ""}${waits ? `, ${waits}` : ""}; ${who}`, runs() ? "good" : "");
}

function become(state) {
  const another = live.state?.session !== state.session, back = away;
  live.state = state;
  away = false;
  status();
  if (another || back) field.again();
  if (another) {
    Object.assign(sound, { gaps: 0, causes: {} });
    silences = missing = 0;
    hole = null;
    refit();
  }
  show.params?.(state.params);
  show.sources?.(state.sources);
  enable(); // what was drawn anew, too
  field.set({ sources: state.sources, recorded: live.hello.alone && runs() && !!state.recorded }); // of a shared page
  $("log").textContent = state.log && runs() ? `Recording to ${state.log}` : state.recorded;
  note(state.why);
}

/** What can be done by hand now, and what buttons would do. */
function enable() {
  const on = !away && runs(), phase = live.state?.phase;
  $("run").textContent = on ? "Stop" : "Start";
  $("record").textContent = on && live.state.log ? "Stop recording" : live.hello.alone ? "Play recorded motion" : "Record";
  $("record").setAttribute("aria-pressed", String(!!(on && live.state.log)));
  for (const id of ["run", "record"]) $(id).disabled = !mine() || phase === "stopping";
  $("record").hidden = live.hello.alone === "without motion";
  $("mark").disabled = !mine() || phase !== "running";
  $("control").hidden = away || mine();
  $("field").setAttribute("aria-disabled", String(!mine()));
  for (const control of document.querySelectorAll(".side input, .side select, .side button")) // a page that watches may listen
    if (!control.closest("[aria-labelledby=h-sound]")) control.disabled = !mine();
}

/** Without the server nothing is known of the session. */
function lost({ state, code, why, seconds }) {
  const more = code === 4401 ? "" : "; load this page again to retry";
  if (state === "silent") words(`No answer from the server since ${seconds} s; trying again`, "bad");
  else if (state === "refused") words(`Refused: ${why}${more}`, "bad");
  else words(code === ENDED ? "The server has ended; trying again" : "Connection lost: the server or the network is gone; trying again", "bad");
  if (!away && runs()) {
    silences++;
    hole ??= live.report;
  }
  away = true;
  $("clock").textContent = "–";
  if (live.state) enable();
}

function found() {
  if (away && live.state) become(live.state);
}

/** What was not computed in a silence, by the clock of the server; its first reports may have to catch up. */
function fill(report) {
  if (report.session !== hole.session) hole = null;
  else {
    hole.all ??= missing;
    hole.back ??= report.time;
    missing = hole.all + Math.max(0, report.time - hole.time - (report.at - hole.at) / live.hello.fs);
    if (report.time > hole.back + 1) hole = null;
    note(missing > 0.2 ? `The server did not answer; ${missing.toFixed(1)} s were not computed.` : "");
  }
}

function count(report) {
  if (hole) fill(report);
  live.report = report;
  const { passivity: _, ...limited } = report.clips; // what damps a force is told with its energy
  const all = Object.values(limited).flatMap(Object.values).reduce((a, b) => a + b, 0);
  if (all > clips) clipped = performance.now();
  clips = all;
  $("clock").textContent = `${report.seconds.toFixed(1)} s`;
  const broken = Object.keys(report.faults);
  if (broken.length) note(`Not finite: ${broken.join(", ")}. The session was faded out.`);
  if (live.state && !away) status();
}

function take(data) {
  const head = new Float64Array(data, 0, HEAD), n = head[5], all = new Float32Array(data, 8 * HEAD), { hello, history } = live;
  if (!hello || !n) return;
  const of = hello.inputs.length, row = of + hello.outputs.length + heard;
  history.push(head[0], n, all);
  if (level.take(all.subarray(row * n, (row + 1) * n).map(v => v * hello.outputs[heard].full), hello.fs)) fitted();
  hello.outputs.forEach(({ name }, i) => { live.outputs[name] = history.newest(of + i); });
  live.blocks++;
  field.dirty = field.dirty || !!field.kind;
  if (head[1] && head[1] !== last && marks.length < 64) marks.push(last = head[1]);
}

const SAID = { hello: greet, state: become, report: count, error: m => note(`${m.about}: ${m.text}`) };
link.onmessage = ({ data: m }) => {
  if (m.samples) take(m.samples);
  else if (m.text) SAID[m.text.is]?.(m.text);
  else if (m.state === "heard") found();
  else if (m.state) { if (m.state !== "open") lost(m); }
  else sound.told(m);
};

/** A name that is the same when the page is loaded again, and another one in each tab. */
function identity() {
  const again = performance.getEntriesByType("navigation")[0]?.type === "reload", made = Math.random().toString(36).slice(2);
  try {
    const name = again && sessionStorage.getItem("page") || made;
    sessionStorage.setItem("page", name);
    return name;
  } catch { return made; } // a frame in a notebook may have no storage
}
const page = identity();
function connect() {
  words("Connecting", "");
  say({ open: `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`, token: location.hash.slice(1), page });
}
addEventListener("hashchange", connect); // the address of a server that was started again
connect();

// By hand -------------------------------------------------------------------------------------------------------------
function hear(k) {
  heard = k;
  $("heard").value = k;
  const { inputs: { length: of }, outputs } = live.hello, { name, vibrates } = outputs[k];
  $("spectrum-of").textContent = name;
  $("h-first").textContent = vibrates ? `What vibrates in ${name}` : `Output ${name}`;
  for (const p of live.panels) {
    const [{ index, whole = index }] = p.signals, mine = p.signals.some(s => (vibrates ? s.whole : s.index) === of + k);
    if (index >= of) $(mine ? "first" : "outputs").append(p.root);
    p.root.hidden = false;
    p.twin = mine && vibrates ? live.panels.find(q => q.signals[0].index === whole) : p; // which is left out if both are one curve
  }
  refit();
}

/** The loudness follows what vibrates from now on. */
function refit() {
  level = new Level(live.hello.outputs[heard]);
  sound.hear(heard, level);
  fitted();
}

function fitted() {
  sound.amplify();
  $("left-out").textContent = level.words();
}

$("run").onclick = () => say({ do: runs() ? "stop" : "start" });
$("mark").onclick = () => say({ do: "mark" });
$("record").onclick = () => say({ do: runs() && live.state.log ? "stop" : "record" });
$("control").onclick = () => say({ do: "control" });
$("heard").onchange = e => hear(+e.target.value);
$("gain").oninput = e => { $("gain-is").textContent = `${e.target.value} dB`.replace("-", "−"); sound.loud(+e.target.value); };
$("fit").onclick = refit;
$("map").onchange = e => { field.set({ parts: { ...field.parts, hidden: e.target.checked } }); };
$("sound").onclick = async () => {
  try {
    const on = await sound.toggle();
    $("sound").textContent = on ? "Turn sound off" : "Turn sound on";
  } catch (e) { note(`No sound: ${e.message}`); }
};

if (matchMedia("(max-width: 560px)").matches) $("driven").open = false;

const typing = e => e.target.matches?.("input, select, textarea") || e.ctrlKey || e.metaKey || e.altKey;
addEventListener("keydown", e => {
  if (typing(e)) return;
  const button = e.target.matches?.("button, summary");
  if (e.key === " " && !button) { if (!e.repeat) $("run").click(); } 
  else if (e.key.toLowerCase() === "m") { if (!e.repeat) $("mark").click(); }
  else if (e.key.toLowerCase() === "r") { if (!e.repeat) $("record").click(); }
  else if ((button && e.key === "Enter") || !mine() || !field.key(e, true)) return;
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
  const db = Math.max(QUIET, level?.db ?? QUIET), bar = $("meter"), now = Math.min(1, Math.round(200 * (1 - db / QUIET)) / 200);
  if (level) level.peak *= 10 ** (-3 * seconds); // 60 dB in a second, as the number beside it is of half a second
  if (part !== now) {
    part = now;
    bar.firstElementChild.style.transform = `scaleX(${part})`;
    bar.classList.toggle("high", db > -3);
  }
}

/** The meter in words: of the newest half second. */
function loudness() {
  const { hello, history } = live, { unit, full, vibrates } = hello.outputs[heard]; // the whole, where nothing vibrates
  if (!runs() || away) return "–";
  const rms = history.rms(hello.inputs.length + (vibrates ? hello.outputs.length : 0) + heard, hello.fs / 2);
  const { factor, unit: shown } = scaled(unit, rms > LEAST * full ? rms : full);
  return `${short(rms > LEAST * full ? rms * factor : 0)} ${shown} rms`.replace("  ", " ");
}

/** What passivity controllers observed and did. */
function energy() {
  const { energy: seen, clips: changed } = live.report ?? {};
  const said = (unit, v) => { const { factor, unit: shown } = scaled(unit, v); return `${short(v * factor)} ${shown}`; };
  return Object.entries(seen ?? {}).map(([name, { given, most }]) => `${name} gave at most ${said("J", given)}`
    + (changed.passivity?.[name] ? ` (${counted(changed.passivity[name], "sample")} changed, by up to ${said("N", most)})` : "")).join("; ");
}

/** What was late, of all that is made, drawn and heard, and why. */
function gaps() {
  const { lost, underruns, skipped, rejected } = live.report ?? {}, all = sound.missing();
  if (underruns) all.push(`${underruns} in the stimulus (server late: ${short(lost / live.hello.fs)} s lost)`);
  if (skipped) all.push(`${counted(skipped, "block")} not drawn (browser late)`);
  for (const [why, n] of Object.entries(rejected ?? {})) all.push(`${counted(n, "row")} of motion rejected (${why})`);
  if (silences) all.push(`${silences} without an answer from the server${missing > 0.2 ? ` (${missing.toFixed(1)} s were not computed)` : ""}`);
  return all.join("; ") || "none";
}

const median = all => all.slice().sort((a, b) => a - b)[all.length >> 1];
function lag() {
  if (!live.drawn.length) return "";
  const queue = sound.figures ? ` (${(1e3 * sound.figures.fill).toFixed(0)} of them in its queue)` : "";
  const heardToo = sound.played.length ? `, to the sound card ${median(sound.played).toFixed(0)} ms${queue}` : "";
  return `From the pointer to the picture ${median(live.drawn).toFixed(0)} ms${heardToo} (medians), without the ${Math.round(1e3 * (live.hello.behind?.[1] ?? 0))} ms of smoothing.`;
}

let before = 0;
const curves = new Turn(), lines = new Turn();
function plot(now) {
  const { fs, inputs, outputs } = live.hello;
  shown = live.history.end;
  live.pictures++;
  for (const p of live.panels) { p.draw(fs, +$("window").value, colours); p.tell(); }
  drawn = Object.fromEntries(inputs.map(({ name }, k) => [name, live.history.newest(k)]));
  if (spectrum.take(inputs.length + heard, fs) || lines.due(now, 250))
    lines.take(now, () => spectrum.draw(fs, outputs[heard].unit, colours));
  for (const t of marks) if (live.drawn.push(clock() - t) > 1000) live.drawn.shift();
  marks = [];
}

function tick(now) {
  requestAnimationFrame(tick);
  let seen = field.refresh(now, colours, live.outputs);
  const telling = live.hello && now - told > 250;
  meter(Math.min(0.2, (now - before) / 1000));
  before = now;
  if (telling) {
    told = now;
    for (const p of live.panels) { p.leaveOut(live.hello.fs); p.rms(live.hello.fs); }
    sound.ask();
    $("lag").textContent = lag();
    $("level").textContent = loudness();
    $("meter").setAttribute("aria-valuenow", Math.round(QUIET * (1 - part)));
    $("meter").setAttribute("aria-valuetext", $("level").textContent);
    $("gaps").textContent = gaps();
    $("energy").textContent = energy();
    $("observed").hidden = !$("energy").textContent;
    const on = now - clipped < 2000;
    if (on !== $("clip").classList.contains("on")) { // told once, as it is read aloud
      $("clip").classList.toggle("on", on);
      $("clip").textContent = on ? "clip" : "no clip";
    }
  }
  const fresh = live.history && (live.history.end !== shown || now - curves.last > 500); // or another size, theme or choice
  if (fresh && curves.due(now, calm.matches ? 250 : 0)) curves.take(now, () => { plot(now); seen = true; });
  if (seen || telling) $("where").textContent = field.words(runs() && !away ? drawn : {}); // what is drawn, in its words
}
requestAnimationFrame(tick);
