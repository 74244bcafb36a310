// The field in which fingers move: mouse, pen, touch and keys in; places drawn, or the picture of a scene for the eye.

import { FROM, axes } from "./controls.js";
import { pictures } from "./pictures.js";
import { Backdrop, Turn, frame, sharp } from "./plots.js";
import { scaled, short, text, ticks } from "./scales.js";

const FINGERS = 10, FIRM = 0.5, OFTEN = 2; // pressure without a sensor; ms between moves
const STEP = 0.5, SLOW = 0.1, TAP = 0.02; // of the field per s by keys; s that a tap lasts
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] };
const MARGIN = { left: 58, right: 14, top: 12, bottom: 38 }, EDGE = { left: 12, right: 12, top: 12, bottom: 12 }; // css pixels
const PIXELS = 96 / 0.0254, RIDGE = "#b08d57"; // in a nominal m
const calm = matchMedia("(prefers-reduced-motion: reduce)");
const clip = v => Math.min(1, Math.max(0, v));
const lowest = taken => Array.from({ length: FINGERS }, (_, k) => k).find(k => !taken.has(k));

export class Field {
  /** `say` takes messages for the server; `bare`: without axes, as a participant sees it. */
  constructor(canvas, say, bare = false) {
    Object.assign(this, { canvas, say, bare, view: null, sources: {}, units: {}, beside: [0, 0], dirty: true, back: new Backdrop(canvas) });
    Object.assign(this, { parts: { surface: true, cursor: true, hidden: false }, turn: new Turn() });
    Object.assign(this, { fingers: new Map(), held: new Map(), keys: new Map() });
    this.hover = { finger: 0, t: 0 };
    this.box = { x: 0, y: 0, w: 1, h: 1 };
    canvas.addEventListener("pointerdown", e => this.down(e));
    // raw updates do not wait for the next frame as pointermove does; only secure contexts have them, 127.0.0.1 is one
    canvas.addEventListener("onpointerrawupdate" in window ? "pointerrawupdate" : "pointermove", e => this.move(e));
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(kind, e => this.up(e));
    canvas.addEventListener("contextmenu", e => e.preventDefault());
    addEventListener("blur", () => this.keys.clear());
    new ResizeObserver(() => { this.dirty = true; }).observe(canvas);
  }

  /** A new scene or new sources; what is drawn, and how far (m) beside a pointer it is. */
  set({ view = this.view, units = this.units, sources = this.sources, recorded = this.recorded, parts = this.parts, beside = this.beside }) {
    Object.assign(this, { view, units, sources, recorded, parts, beside, dirty: true, drawn: null });
    this.kind = this.bare || view?.kind === "surface" ? pictures[view?.kind] : null; // else a field
    this.canvas.classList.toggle("surface", !!this.kind);
    this.canvas.classList.toggle("flat", !axes(this.sources).v.length);
  }

  // Fingers ------------------------------------------------------------------------------------------------------------
  place(px, py) {
    if (!this.cam?.from) return [clip((px - this.box.x) / this.box.w), clip(1 - (py - this.box.y) / this.box.h)];
    const [x, y] = this.cam.from(px, py), [across, up] = this.ranges();
    return [clip((x - across[0]) / (across[1] - across[0])), clip((y - up[0]) / (up[1] - up[0]))];
  }

  /** What the two ends of an axis of the field mean in m, for an input that the pointer does not drive from 0 to `all`. */
  span(input, all) {
    const { from, low, high } = this.sources[input] ?? {};
    return from === "u" || from === "v" ? [low, high] : [0, all];
  }

  /** The same of the left and right end, and the lower and upper, of the surface. */
  ranges() {
    const { inputs, width, height } = this.view;
    return [this.span(inputs.x, width), this.span(inputs.y, height)];
  }

  put(finger, u, v, p, on, t = performance.timeOrigin + performance.now()) {
    this.hover.late = null; // which is older, and would lift the finger
    this.fingers.set(finger, { u, v, p, on });
    this.say({ do: "move", finger, u, v, p, on, t });
    this.dirty = true;
  }

  report(e, on, moving = false) {
    const r = this.canvas.getBoundingClientRect(), { clientLeft, clientTop } = this.canvas, [right, up] = this.beside.map(m => m * PIXELS);
    const hold = this.held.get(e.pointerId) ?? this.hover, all = e.getCoalescedEvents?.() ?? [];
    for (const c of all.length ? all : [e]) {
      const p = on ? clip(c.pressure || (e.pointerType === "pen" ? 0 : FIRM)) : 0;
      const at = this.place(c.clientX - r.left - clientLeft + right, c.clientY - r.top - clientTop - up);
      const go = () => {
        Object.assign(hold, { t: c.timeStamp, late: null });
        this.put(hold.finger, ...at, p, on, performance.timeOrigin + c.timeStamp);
      };
      if (moving && c.timeStamp - hold.t < OFTEN) hold.late = go; // unless another one comes, with the next frame
      else go();
    }
  }

  down(e) {
    const finger = lowest(new Set([...this.held.values()].map(h => h.finger)));
    if (this.held.has(e.pointerId) || e.button > 0 || finger === undefined) return;
    this.held.set(e.pointerId, { finger, t: 0 });
    try { this.canvas.setPointerCapture(e.pointerId); } catch { /* it has left already */ }
    this.report(e, 1);
  }

  move(e) {
    if (this.held.has(e.pointerId)) this.report(e, 1, true);
    else if (!this.held.size && e.pointerType !== "touch") this.report(e, 0, true); // a mouse or a pen over it
  }

  up(e) {
    const hold = this.held.get(e.pointerId);
    if (!hold) return;
    if (e.type === "pointerup") this.report(e, 0);
    else { // a pointer that is taken away may have no place: it is lifted where it was
      hold.late?.();
      const { u, v } = this.fingers.get(hold.finger);
      this.put(hold.finger, u, v, 0, 0);
    }
    this.held.delete(e.pointerId);
  }

  /** A new session learns where the fingers are. */
  again() { for (const [finger, f] of this.fingers) this.put(finger, f.u, f.v, f.p, f.on); }

  // Keys ---------------------------------------------------------------------------------------------------------------
  /** Takes a key; true if it was one of the field's. */
  key(e, down) {
    const first = this.fingers.get(0) ?? { u: 0.5, v: 0.5, p: FIRM, on: 0 }, p = first.p || FIRM;
    if (e.key in ARROWS) {
      if (!down) this.keys.delete(e.key);
      else if (!this.keys.has(e.key)) {
        const speed = e.shiftKey ? SLOW : STEP;
        if (!this.keys.size) this.since = performance.now();
        this.keys.set(e.key, speed);
        this.put(0, clip(first.u + ARROWS[e.key][0] * speed * TAP), clip(first.v + ARROWS[e.key][1] * speed * TAP), p, 1);
      }
      return true;
    }
    if (!down) return false;
    if (e.key === "Enter") { if (!e.repeat) this.put(0, first.u, first.v, first.on ? 0 : FIRM, first.on ? 0 : 1); }
    else if (e.key === "+" || e.key === "=") this.put(0, first.u, first.v, clip(p + 0.05), 1);
    else if (e.key === "-") this.put(0, first.u, first.v, Math.max(0.05, p - 0.05), 1);
    else return false;
    return true;
  }

  /** With each frame: says what was held back, and moves the finger on while arrows are held. */
  tick(now) {
    for (const hold of [this.hover, ...this.held.values()]) hold.late?.();
    if (!this.keys.size) return;
    const dt = Math.min(0.1, (now - this.since) / 1000), f = this.fingers.get(0);
    if (dt <= 0) return; // a frame that began before the key came would move it back
    let { u, v } = f;
    for (const [key, speed] of this.keys) { u += ARROWS[key][0] * speed * dt; v += ARROWS[key][1] * speed * dt; }
    this.since = now;
    this.put(0, clip(u), clip(v), f.p, 1);
  }

  // Drawing ------------------------------------------------------------------------------------------------------------
  /** What moves the inputs where no finger does: [sentence, inputs]. */
  moved() {
    const all = Object.entries(this.sources).map(([name, s]) => [name, this.recorded ? { from: "recorded" } : s]), of = {};
    if (all.some(([, { from }]) => ["u", "v", "pressure", "contact"].includes(from))) return ["", []];
    const moving = all.filter(([, { from }]) => from !== "value");
    for (const [name, { from }] of moving) (of[FROM[from] ?? "the recorded motion"] ??= []).push(name);
    const said = Object.entries(of).map(([what, names]) => `${what} moves ${names.join(", ")}`).join("; ");
    return [said && said[0].toUpperCase() + said.slice(1), moving.map(([name]) => name)];
  }

  /** A sentence on the first finger as it is drawn, and on where the stimulus has followed it to, by the sample that is drawn. */
  words(drawn = {}) {
    const f = this.fingers.get(0), { u, v } = axes(this.sources), [moves, moved] = this.moved();
    const at = moved.filter(name => Number.isFinite(drawn[name])).map(name => {
      const { factor, unit } = scaled(this.units[name], Math.abs(drawn[name]));
      return `${name} = ${short(drawn[name] * factor)} ${unit}`.trim();
    });
    if (moves) return `${moves}${at.length ? `; it is at ${at.join(", ")}` : ""}.`;
    if (!f) return "No finger touches.";
    const say = ({ input, low, high }, at) => {
      const { factor, unit } = scaled(this.units[input], Math.max(Math.abs(low), Math.abs(high)));
      return `${input} = ${short((low + (high - low) * at) * factor)} ${unit}`.trim();
    };
    const mine = (all, at) => all.filter(a => a.finger === 0).map(a => say(a, at));
    const pressure = f.on && Object.values(this.sources).some(s => s.from === "pressure") ? [`pressure ${short(f.p)}`] : [];
    const is = [f.on ? "The finger touches" : "The finger is lifted", ...mine(u, f.u), ...mine(v, f.v), ...pressure].join(", ");
    const known = [...u, ...v].filter(a => a.finger === 0 && Number.isFinite(drawn[a.input]));
    const followed = known.map(a => say(a, (drawn[a.input] - a.low) / (a.high - a.low)));
    return `${is}${followed.length ? `; the stimulus is at ${followed.join(", ")}` : ""}.`;
  }

  axis(all, length) { // ticks of what an axis drives: of the first, if they differ
    if (!all.length) return { name: "", at: [] };
    const { input, low, high } = all[0], { factor, unit } = scaled(this.units[input], Math.max(Math.abs(low), Math.abs(high)));
    const same = all.filter(a => a.low === low && a.high === high && this.units[a.input] === this.units[input]);
    const { step, at } = ticks(Math.min(low, high) * factor, Math.max(low, high) * factor, length / 80);
    const name = same.map(a => a.input).join(", ") + (unit && ` / ${unit}`);
    return { name, at: at.map(v => [(v / factor - low) / (high - low), text(v, step)]) };
  }

  /** With each frame: draws what is new, but takes at most a third of the time; whether it has drawn. */
  refresh(now, colours, values) {
    this.tick(now);
    if (!this.dirty || !this.turn.due(now, calm.matches && this.kind ? 100 : 0)) return false;
    this.dirty = false;
    this.turn.take(now, () => this.draw(colours, values));
    return true;
  }

  draw(colours, values) {
    if (this.kind) { this.picture(values); return; }
    if (!this.canvas.clientWidth) return; // hidden, as of a scene without inputs
    const { canvas, back, sources, view, parts } = this, { left, right, top, bottom } = this.bare ? EDGE : MARGIN, { u, v } = axes(sources);
    const box = this.box = { x: left, y: top, w: canvas.clientWidth - left - right, h: canvas.clientHeight - top - bottom };
    this.cam = null;
    const paper = back.changed(colours, sources, this.units, view, parts, this.recorded);
    if (paper) this.paper(paper, box, colours, u, v);
    const g = back.show();
    g.scale(devicePixelRatio || 1, devicePixelRatio || 1);
    for (const [finger, f] of this.marks(values))
      this.finger(g, box, colours, finger, f, ...[u, v].map(all => all.some(a => a.finger === finger)));
  }

  paper({ g, high }, box, colours, u, v) { // what stays while fingers move
    if (this.parts.hidden && this.view?.hidden) {
      const [low, high] = this.span(this.view.values[0], this.view.length), at = x => box.w * clip((x - low) / (high - low));
      g.fillStyle = RIDGE;
      for (const [begin, end] of this.view.hidden) g.fillRect(box.x + at(begin), box.y, at(end) - at(begin), box.h);
    }
    g.strokeStyle = this.bare ? colours.soft : colours.line;
    if (!this.bare || this.parts.surface) g.strokeRect(box.x + 0.5, box.y + 0.5, box.w, box.h);
    if (this.bare) return;
    const across = this.axis(u, box.w), up = this.axis(v, box.h);
    const xs = across.at.map(([k, s]) => [box.x + k * box.w, s]), ys = up.at.map(([k, s]) => [box.y + (1 - k) * box.h, s]);
    frame(g, box, colours, xs, ys, up.name);
    g.textAlign = "center";
    g.textBaseline = "alphabetic";
    g.fillText(across.name, box.x + box.w / 2, high - 6);
    g.fillText(this.moved()[0], box.x + box.w / 2, box.y + box.h / 2, box.w);
  }

  /** The fingers that are drawn: where they touch, or where the stimulus has its only position. */
  marks(values) {
    if (!this.parts.cursor) return [];
    if (!this.bare || !this.view) return this.fingers;
    const [name] = this.view.values, [low, high] = this.span(name, this.view.length);
    return values ? [[0, { u: clip((values[name] - low) / (high - low)), v: 0.5, p: FIRM, on: 1 }]] : [];
  }

  finger(g, box, colours, finger, { u, v, p, on }, crosses, climbs) {
    const x = box.x + u * box.w, y = box.y + (1 - v) * box.h;
    g.strokeStyle = g.fillStyle = on ? colours.accent : colours.soft;
    g.lineWidth = 1.5;
    g.setLineDash(on ? [] : [4, 4]);
    g.beginPath();
    if (crosses) { g.moveTo(x, box.y); g.lineTo(x, box.y + box.h); }
    if (climbs) { g.moveTo(box.x, y); g.lineTo(box.x + box.w, y); }
    g.stroke();
    g.beginPath();
    g.arc(x, y, 8 + 12 * p, 0, 2 * Math.PI);
    if (on) g.fill(); else g.stroke();
    g.setLineDash([]);
    if (this.fingers.size < 2) return;
    g.fillStyle = on ? colours.panel : colours.soft;
    g.textAlign = "center";
    g.textBaseline = "middle";
    g.fillText(`${finger + 1}`, x, y + 0.5);
  }

  /** The picture of the scene; the same again needs no drawing. */
  picture(values) {
    const { canvas, view, parts, kind } = this;
    const key = JSON.stringify([values && view.values.map(name => values[name]), canvas.clientWidth, canvas.clientHeight]);
    if (key === this.drawn || Math.min(canvas.clientWidth, canvas.clientHeight) < 48) return; // not laid out yet
    this.drawn = key;
    const { g, wide, high } = sharp(canvas);
    this.cam = kind.fit(view, wide, high);
    this.box = { x: 0, y: 0, w: wide, h: high };
    kind.draw(g, this.cam, view, values, parts);
  }
}
