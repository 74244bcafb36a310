// The field in which fingers move: mouse, pen, touch and keys in, places drawn; or the soft surface of a scene for the eye.

import { axes } from "./controls.js";
import { Backdrop, frame, sharp } from "./plots.js";
import { scaled, short, text, ticks } from "./scales.js";
import { camera, draw as drawSurface, levelAt } from "./surface.js";

const FINGERS = 10, FIRM = 0.5, OFTEN = 2; // pressure without a sensor; ms between moves
const STEP = 0.5, SLOW = 0.1, TAP = 0.02; // of the field per s by keys; s that a tap lasts
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] };
const MARGIN = { left: 58, right: 14, top: 12, bottom: 38 }, RADIUS = 0.005; // css pixels; of an avatar in m
const clip = v => Math.min(1, Math.max(0, v));
const lowest = taken => Array.from({ length: FINGERS }, (_, k) => k).find(k => !taken.has(k));

export class Field {
  /** `say` takes messages for the server. */
  constructor(canvas, say) {
    Object.assign(this, { canvas, say, view: null, sources: {}, units: {}, dirty: true, hard: false, back: new Backdrop(canvas) });
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

  /** A new scene or new sources. */
  set({ view = this.view, units = this.units, sources = this.sources }) {
    Object.assign(this, { view, units, sources, dirty: true, drawn: null });
    this.canvas.classList.toggle("surface", !!this.view);
    this.canvas.classList.toggle("flat", !axes(this.sources).v.length);
    this.level = this.view && levelAt(this.view);
  }

  // Fingers ------------------------------------------------------------------------------------------------------------
  place(px, py) {
    if (!this.cam) return [clip((px - this.box.x) / this.box.w), clip(1 - (py - this.box.y) / this.box.h)];
    const [x, y] = this.cam.from(px, py), [across, up] = this.ranges();
    return [clip((x - across[0]) / (across[1] - across[0])), clip((y - up[0]) / (up[1] - up[0]))];
  }

  /** What the left and right end, and the lower and upper, of the surface mean in m. */
  ranges() {
    const { view, sources } = this;
    const of = (input, all) => {
      const { from, low, high } = sources[input] ?? {};
      return from === "u" || from === "v" ? [low, high] : [0, all];
    };
    return [of(view.inputs.x, view.width), of(view.inputs.y, view.height)];
  }

  put(finger, u, v, p, on, t = performance.timeOrigin + performance.now()) {
    this.fingers.set(finger, { u, v, p, on });
    this.say({ do: "move", finger, u, v, p, on, t });
    this.dirty = true;
  }

  report(e, on, moving = false) {
    const r = this.canvas.getBoundingClientRect(), hold = this.held.get(e.pointerId) ?? this.hover;
    const all = e.getCoalescedEvents?.() ?? [];
    for (const c of all.length ? all : [e]) {
      const p = on ? clip(c.pressure || FIRM) : 0, at = this.place(c.clientX - r.left, c.clientY - r.top);
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
    if (!this.held.has(e.pointerId)) return;
    this.report(e, 0);
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
    if (e.key === "Enter") this.put(0, first.u, first.v, first.on ? 0 : FIRM, first.on ? 0 : 1);
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
    let { u, v } = f;
    for (const [key, speed] of this.keys) { u += ARROWS[key][0] * speed * dt; v += ARROWS[key][1] * speed * dt; }
    this.since = now;
    this.put(0, clip(u), clip(v), f.p, 1);
  }

  // Drawing ------------------------------------------------------------------------------------------------------------
  /** A sentence on the first finger. */
  words() {
    const f = this.fingers.get(0), { u, v } = axes(this.sources);
    if (!f) return "No finger touches.";
    const say = ({ input, low, high }, at) => {
      const { factor, unit } = scaled(this.units[input], Math.max(Math.abs(low), Math.abs(high)));
      return `${input} = ${short((low + (high - low) * at) * factor)} ${unit}`.trim();
    };
    const mine = (all, at) => all.filter(a => a.finger === 0).map(a => say(a, at));
    const pressure = f.on ? [`pressure ${short(f.p)}`] : [];
    return [f.on ? "The finger touches" : "The finger is lifted", ...mine(u, f.u), ...mine(v, f.v), ...pressure].join(", ") + ".";
  }

  axis(all, length) { // ticks of what an axis drives: of the first, if they differ
    if (!all.length) return { name: "", at: [] };
    const { input, low, high } = all[0], { factor, unit } = scaled(this.units[input], Math.max(Math.abs(low), Math.abs(high)));
    const same = all.filter(a => a.low === low && a.high === high && this.units[a.input] === this.units[input]);
    const { step, at } = ticks(Math.min(low, high) * factor, Math.max(low, high) * factor, length / 80);
    const name = same.map(a => a.input).join(", ") + (unit && ` / ${unit}`);
    return { name, at: at.map(v => [(v / factor - low) / (high - low), text(v, step)]) };
  }

  draw(colours, outputs) {
    if (this.view) { this.surface(this.avatars(outputs)); return; }
    const { canvas, back, sources } = this, { left, right, top, bottom } = MARGIN, { u, v } = axes(sources);
    const box = this.box = { x: left, y: top, w: canvas.clientWidth - left - right, h: canvas.clientHeight - top - bottom };
    this.cam = null;
    const paper = back.changed(colours, sources, this.units);
    if (paper) this.paper(paper, box, colours, u, v);
    const g = back.show();
    g.scale(devicePixelRatio || 1, devicePixelRatio || 1);
    for (const [finger, f] of this.fingers)
      this.finger(g, box, colours, finger, f, ...[u, v].map(all => all.some(a => a.finger === finger)));
  }

  paper({ g, high }, box, colours, u, v) { // what stays while fingers move
    const across = this.axis(u, box.w), up = this.axis(v, box.h);
    g.strokeStyle = colours.line;
    g.strokeRect(box.x + 0.5, box.y + 0.5, box.w, box.h);
    const xs = across.at.map(([k, s]) => [box.x + k * box.w, s]), ys = up.at.map(([k, s]) => [box.y + (1 - k) * box.h, s]);
    frame(g, box, colours, xs, ys, up.name);
    g.textAlign = "center";
    g.textBaseline = "alphabetic";
    g.fillText(across.name, box.x + box.w / 2, high - 6);
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

  /** What of a surface is drawn; the same again needs no drawing. */
  avatars(outputs) {
    const value = name => (name && Number.isFinite(outputs[name]) ? outputs[name] : 0);
    return this.view.avatars.map(a => ({ x: value(a.x), y: value(a.y), depth: value(a.depth) }));
  }

  surface(avatars) {
    const { canvas, view: { width, height } } = this;
    const key = JSON.stringify([avatars, canvas.clientWidth, canvas.clientHeight, this.hard]);
    if (key === this.drawn || Math.min(canvas.clientWidth, canvas.clientHeight) < 48) return; // not laid out yet
    this.drawn = key;
    const { g, wide, high } = sharp(canvas);
    this.cam = camera(width, height, 12, 12, wide - 24, high - 24);
    drawSurface(g, this.cam, avatars, width, height, RADIUS, this.hard && this.level);
  }
}
