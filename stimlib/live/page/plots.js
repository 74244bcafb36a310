// Live curves on plain canvases: signals over time, a panel for each kind and unit, and the spectrum of what is heard.

import { pretty, roundUp, scaled, short, text, ticks } from "./scales.js";
import { density, lines, smooth } from "./spectrum.js";

const LEFT = 58, RIGHT = 10, TOP = 8, BOTTOM = 20, LOUD = 100; // css pixels round a plot; dB that a spectrum shows

/** The newest samples of some signals, in rings that know their absolute index. */
export class History {
  /** `size` samples of as many signals as there are `factors`, by which what comes is multiplied. */
  constructor(size, factors) {
    Object.assign(this, { size, factors, end: 0, rings: factors.map(() => new Float32Array(size).fill(NaN)) });
  }
  /** n samples of each signal, one signal after the other, the first of them number `first`; a gap stays empty. */
  push(first, n, samples) {
    if (first < this.end) { this.end = 0; for (const r of this.rings) r.fill(NaN); } // a new session
    const { size, factors } = this, skipped = Math.min(first - this.end, size);
    this.rings.forEach((r, i) => {
      for (let k = first - skipped; k < first; k++) r[k % size] = NaN;
      for (let k = 0; k < n; k++) r[(first + k) % size] = samples[i * n + k] * factors[i];
    });
    this.end = first + n;
  }
  newest(i) { return this.end ? this.rings[i][(this.end - 1) % this.size] : NaN; }
  /** The newest `n` of a signal, or null where there are fewer. */
  last(i, n) {
    if (this.end < n || n > this.size) return null;
    const out = Float32Array.from({ length: n }, (_, k) => this.rings[i][(this.end - n + k) % this.size]);
    return out.some(Number.isNaN) ? null : out;
  }
}

/** A canvas that is as sharp as the screen: calls back with its context and size in css pixels. */
export function sharp(canvas) {
  const wide = canvas.clientWidth, high = canvas.clientHeight, ratio = devicePixelRatio || 1;
  if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
    canvas.width = Math.round(wide * ratio);
    canvas.height = Math.round(high * ratio);
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, wide, high);
  return { g, wide, high };
}

/** The colours of the page's style, as they are in its theme now. */
export function palette() {
  const probe = document.body.appendChild(document.createElement("i"));
  const get = name => { probe.style.color = `var(--${name})`; return getComputedStyle(probe).color; };
  const curves = [1, 2, 3, 4, 5, 6].map(k => get(`curve-${k}`));
  const [ink, soft, line, panel, accent] = ["ink", "muted", "line", "panel", "accent"].map(get);
  probe.remove();
  return { ink, soft, line, panel, accent, curves };
}

const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3], [], [6, 3]]; // so that colour is not the only difference

export function frame(g, box, colours, xs, ys, name) {
  g.font = "12px system-ui, sans-serif";
  g.strokeStyle = colours.line;
  g.fillStyle = colours.soft;
  g.lineWidth = 1;
  g.textAlign = "right";
  g.textBaseline = "middle";
  g.beginPath();
  for (const [at, label] of ys) {
    g.moveTo(box.x, Math.round(at) + 0.5);
    g.lineTo(box.x + box.w, Math.round(at) + 0.5);
    g.fillText(label, box.x - 5, at);
  }
  g.textAlign = "center";
  g.textBaseline = "top";
  for (const [at, label] of xs) {
    g.moveTo(Math.round(at) + 0.5, box.y);
    g.lineTo(Math.round(at) + 0.5, box.y + box.h);
    if (label) g.fillText(label, Math.min(at, box.x + box.w - 6), box.y + box.h + 5);
  }
  g.stroke();
  g.save();
  g.translate(11, box.y + box.h / 2);
  g.rotate(-Math.PI / 2);
  g.textBaseline = "middle";
  g.fillText(name, 0, 0);
  g.restore();
}

/** Lowest and highest of a ring in absolute bins, so that a curve does not flicker as it moves. */
function envelope(ring, size, from, to, per, draw) {
  for (let b = Math.floor(from / per); b * per < to; b++) {
    let low = Infinity, high = -Infinity;
    const stop = Math.min(to, Math.ceil((b + 1) * per));
    for (let k = Math.max(from, Math.ceil(b * per)); k < stop; k++) {
      const v = ring[k % size];
      if (v < low) low = v;
      if (v > high) high = v;
    }
    draw((b + 0.5) * per, low, high);
  }
}

/** One panel over time: signals of one unit, with a legend that says their values. */
export class Panel {
  /** `signals`: [{index, name, unit, low, high}], low and high where a range is known. */
  constructor(signals, history, parent) {
    Object.assign(this, { signals, history, top: 0, bottom: 0 });
    const names = signals.map(s => s.name).join(", ");
    this.root = document.createElement("figure");
    this.root.className = "plot";
    const legend = document.createElement("figcaption");
    this.values = signals.map(({ name }, i) => {
      const item = legend.appendChild(document.createElement("span")), mark = item.appendChild(document.createElement("i"));
      mark.className = `mark mark-${i % 6 + 1}`;
      item.append(name, " = ");
      return item.appendChild(document.createElement("output"));
    });
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `Curve of ${names} over the last seconds`);
    this.values.forEach((v, i) => { v.setAttribute("aria-label", signals[i].name); v.setAttribute("aria-live", "off"); });
    this.root.append(legend, this.canvas);
    parent.append(this.root);
  }

  scale(low, high) {
    const known = this.signals[0];
    if (known.low !== undefined) { low = Math.min(low, known.low); high = Math.max(high, known.high); }
    const most = roundUp(Math.max(Math.abs(low), Math.abs(high), 1e-9));
    if (known.low !== undefined) { this.bottom = low; this.top = high; return; }
    if (high > this.top || high < this.top * 0.3) this.top = high > 0.02 * most ? roundUp(high) : 0;
    if (low < this.bottom || low > this.bottom * 0.3) this.bottom = low < -0.02 * most ? -roundUp(-low) : 0;
    if (this.top === this.bottom) this.top = this.bottom + 1;
  }

  draw(fs, seconds, colours, told) {
    const { g, wide, high } = sharp(this.canvas), { history, signals } = this, { size, end } = history;
    const box = { x: LEFT, y: TOP, w: wide - LEFT - RIGHT, h: high - TOP - BOTTOM };
    if (box.w < 40) return;
    const span = Math.min(size, Math.round(seconds * fs)), from = Math.max(0, end - span), per = span / box.w;
    const curves = signals.map(({ index }) => {
      const points = [];
      envelope(history.rings[index], size, from, end, per, (at, a, b) => points.push(at, a, b));
      return points;
    });
    let low = Infinity, top = -Infinity;
    for (const p of curves)
      for (let i = 0; i < p.length; i += 3) {
        if (p[i + 1] < low) low = p[i + 1];
        if (p[i + 2] > top) top = p[i + 2];
      }
    if (low <= top) this.scale(low, top); else this.scale(0, 0);
    const { factor, unit } = scaled(signals[0].unit, Math.max(Math.abs(this.bottom), Math.abs(this.top)) * 0.999);
    const y = v => box.y + box.h * (this.top - v) / (this.top - this.bottom), x = k => box.x + box.w * (k - (end - span)) / span;
    const up = ticks(this.bottom * factor, this.top * factor, Math.max(2, box.h / 34));
    const across = ticks(-seconds, 0, Math.min(8, box.w / 90));
    frame(g, box, colours, across.at.map(t => [box.x + box.w * (1 + t / seconds), t ? text(t, across.step) : "0 s"]),
      up.at.map(v => [y(v / factor), text(v, up.step)]), unit);
    g.save();
    g.beginPath();
    g.rect(box.x, box.y - 2, box.w, box.h + 4);
    g.clip();
    curves.forEach((points, i) => trace(g, points, x, y, colours.curves[i % 6], DASHES[i % 6], per));
    g.restore();
    if (told) this.values.forEach((v, i) => { v.textContent = `${short(history.newest(signals[i].index) * factor)} ${unit}`; });
  }
}

function trace(g, points, x, y, paint, dash, per) {
  g.strokeStyle = paint;
  g.lineWidth = 1.5;
  g.lineJoin = "round";
  g.setLineDash(per > 1 ? dash : []);
  g.beginPath();
  for (let i = 0, down = false; i < points.length; i += 3) {
    if (!(points[i + 1] <= points[i + 2])) { down = false; continue; } // a gap
    const at = x(points[i]);
    if (down) g.lineTo(at, y(points[i + 1])); else g.moveTo(at, y(points[i + 1]));
    if (points[i + 2] > points[i + 1]) g.lineTo(at, y(points[i + 2]));
    down = true;
  }
  g.stroke();
  g.setLineDash([]);
}

/** The spectrum of one signal: dB over the logarithm of frequency. */
export class Spectrum {
  constructor(canvas, history) {
    Object.assign(this, { canvas, history, mean: null, key: "", peak: -Infinity, at: 0 });
  }

  /** Takes the newest samples of signal `index` if half a window of new ones has come. */
  take(index, fs) {
    const n = lines(fs), { history } = this, key = `${index} ${fs}`;
    if (key !== this.key || history.end < this.at) Object.assign(this, { key, mean: null, at: 0 });
    if (history.end - this.at < n / 4) return;
    const x = history.last(index, n);
    if (!x) return;
    this.at = history.end;
    this.mean = smooth(this.mean, density(x, fs), 0.3);
  }

  draw(fs, unit, colours) {
    const { g, wide, high } = sharp(this.canvas), box = { x: LEFT, y: TOP, w: wide - LEFT - RIGHT, h: high - TOP - BOTTOM - 14 };
    if (box.w < 40) return;
    const n = lines(fs), low = Math.log10(2 * fs / n), span = Math.log10(fs / 2) - low;
    const x = f => box.x + box.w * (Math.log10(f) - low) / span;
    const db = this.mean ? Array.from(this.mean, p => 10 * Math.log10(p + 1e-30)) : [];
    this.peak = db.reduce((a, b, k) => (k > 1 && b > a ? b : a), -Infinity);
    const top = Number.isFinite(this.peak) && this.peak > -250 ? 20 * Math.ceil((this.peak + 3) / 20) : 0;
    const y = v => box.y + box.h * (top - v) / LOUD, xs = [];
    for (let ten = 1; ten < fs; ten *= 10)
      for (const k of [1, 2, 5]) {
        const f = k * ten;
        if (f >= 10 ** low && f <= fs / 2) xs.push([x(f), box.w > 420 || k === 1 ? (f < 1000 ? `${f}` : `${f / 1000}k`) : ""]);
      }
    const square = unit === "1" || !unit ? "1/Hz" : /[*/]/.test(unit) ? `(${pretty(unit)})²/Hz` : `${pretty(unit)}²/Hz`;
    frame(g, box, colours, xs, [0, 20, 40, 60, 80, 100].map(d => [y(top - d), text(top - d, 1)]), "dB");
    g.textAlign = "center";
    g.fillText(`frequency / Hz; dB re 1 ${square}`, box.x + box.w / 2, high - 13);
    g.save();
    g.beginPath();
    g.rect(box.x, box.y, box.w, box.h);
    g.clip();
    g.strokeStyle = colours.curves[1];
    g.lineWidth = 1.5;
    g.beginPath();
    for (let k = 2, pixel = -1, most = -Infinity; k < db.length; k++) { // the highest line of each pixel
      const at = Math.floor(x(k * fs / n));
      most = at === pixel ? Math.max(most, db[k]) : db[k];
      pixel = at;
      if (k + 1 === db.length || Math.floor(x((k + 1) * fs / n)) !== at) g.lineTo(at, y(most));
    }
    g.stroke();
    g.restore();
  }
}

/** Signals in groups that share a panel: places of one unit, named by one letter or alike but for digits (depth1, depth2). */
export function grouped(signals) {
  const groups = new Map();
  for (const s of signals) {
    const stem = s.name.replace(/\d+$/, ""), place = s.unit === "m" || s.unit === "rad";
    const key = place ? `${s.unit} ${stem.length === 1 ? "" : stem}` : `= ${s.name}`;
    groups.set(key, [...groups.get(key) ?? [], s]);
  }
  return [...groups.values()];
}
