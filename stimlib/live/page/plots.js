// Live curves on plain canvases: signals over time, a panel for each kind and unit, and the spectrum of what is heard.

import { Envelope, Strip } from "./curve.js";
import { pretty, roundUp, scaled, short, text, ticks } from "./scales.js";
import { density, lines, smooth } from "./spectrum.js";

const LEFT = 58, RIGHT = 10, TOP = 8, BOTTOM = 20, LOUD = 100; // css pixels round a plot; dB that a spectrum shows

/** The newest samples of some signals, in rings that know their absolute index. */
export class History {
  /** `size` samples of as many signals as there are `factors`, by which what comes is multiplied. */
  constructor(size, factors) {
    Object.assign(this, { size, factors, end: 0, session: 0, rings: factors.map(() => new Float32Array(size).fill(NaN)) });
  }
  /** n samples of each signal, one signal after the other, the first of them number `first`; a gap stays empty. */
  push(first, n, samples) {
    if (first < this.end) { // a new session
      this.end = 0;
      this.session++;
      for (const r of this.rings) r.fill(NaN);
    }
    const { size, factors } = this, skipped = Math.min(first - this.end, size);
    this.rings.forEach((r, i) => {
      for (let k = first - skipped; k < first; k++) r[k % size] = NaN;
      for (let k = 0; k < n; k++) r[(first + k) % size] = samples[i * n + k] * factors[i];
    });
    this.end = first + n;
  }
  /** Root mean square of the newest `n` of a signal, a whole number or not. */
  rms(i, n) {
    const ring = this.rings[i];
    let sum = 0, all = 0;
    for (let k = Math.max(0, this.end - Math.round(n)); k < this.end; k++) {
      const v = ring[k % this.size];
      if (v === v) { sum += v * v; all++; }
    }
    return Math.sqrt(sum / (all || 1));
  }
  newest(i) { return this.end ? this.rings[i][(this.end - 1) % this.size] : NaN; }
  /** The newest `n` of a signal, or null where there are fewer. */
  last(i, n) {
    if (this.end < n || n > this.size) return null;
    const out = new Float32Array(n), ring = this.rings[i], at = (this.end - n) % this.size, right = Math.min(n, this.size - at);
    out.set(ring.subarray(at, at + right));
    out.set(ring.subarray(0, n - right), right);
    return out.some(Number.isNaN) ? null : out;
  }
}

/** A canvas as sharp as the screen, empty: its context and size in css pixels. */
export function sharp(canvas, wide = canvas.clientWidth, high = canvas.clientHeight) {
  const ratio = devicePixelRatio || 1, size = { width: Math.round(wide * ratio), height: Math.round(high * ratio) };
  if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, wide, high);
  return { g, wide, high };
}

const offScreen = new Set(), watched = new IntersectionObserver(all => {
  for (const { target, isIntersecting } of all) if (isIntersecting) offScreen.delete(target); else offScreen.add(target);
});

/** What changes seldom, kept as a picture on which a canvas is drawn anew. */
export class Backdrop {
  constructor(canvas) {
    Object.assign(this, { canvas, kept: document.createElement("canvas"), g: canvas.getContext("2d"), key: [] });
    watched.observe(canvas);
  }
  /** Whether the canvas is there to be seen and has room. */
  get seen() { return !offScreen.has(this.canvas) && this.canvas.clientWidth > LEFT + RIGHT + 40; }
  /** If the canvas or one of `key` is another: an empty picture to paint, as of `sharp`. */
  changed(...key) {
    const { canvas, kept } = this, now = [canvas.clientWidth, canvas.clientHeight, devicePixelRatio, ...key];
    if (now.every((v, i) => v === this.key[i])) return null;
    this.key = now;
    const made = sharp(kept, now[0], now[1]);
    if (canvas.width !== kept.width || canvas.height !== kept.height)
      Object.assign(canvas, { width: kept.width, height: kept.height });
    return made;
  }
  /** The canvas with nothing else on it; in pixels of the screen. */
  show() {
    this.g.setTransform(1, 0, 0, 1, 0, 0);
    this.g.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.g.drawImage(this.kept, 0, 0);
    return this.g;
  }
}

/** What is drawn with a frame, but takes at most a third of the time, on however slow a machine. */
export class Turn {
  cost = 0; // ms
  last = 0;
  costs = []; // of the last thousand times, for benchmarks
  due(now, least) { return now - this.last >= Math.max(least, 3 * this.cost); }
  take(now, draw) {
    const begun = performance.now();
    draw();
    this.last = now;
    const cost = performance.now() - begun;
    this.cost += 0.2 * (cost - this.cost);
    if (this.costs.push(cost) > 1000) this.costs.shift();
  }
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

/** Lines and labels of a plot: [pixel, label] across and up, and what the values are in. */
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

/** One panel over time: signals of one unit, with a legend that says their values. */
export class Panel {
  /** `signals`: [{index, name, unit, low, high, least, whole}]: low and high where a range is known; of what vibrates in `whole`, the least. */
  constructor(signals, history, parent) {
    Object.assign(this, { signals, history, top: 0, bottom: 0, strip: new Strip(), fitted: [] });
    const names = signals.map(s => s.name).join(", "), vibrates = !!signals[0].least;
    this.root = document.createElement("figure");
    this.root.className = vibrates ? "plot vibration" : "plot";
    const legend = document.createElement("figcaption");
    this.values = signals.map(({ name }, i) => {
      const item = legend.appendChild(document.createElement("span")), mark = item.appendChild(document.createElement("i"));
      mark.className = `mark mark-${i % 6 + 1}`;
      item.append(name, vibrates ? " above 40 Hz: " : " = ");
      return item.appendChild(document.createElement("output"));
    });
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `Curve of ${vibrates ? "what vibrates in " : ""}${names} over the last seconds`);
    this.values.forEach((v, i) => { v.setAttribute("aria-label", signals[i].name); v.setAttribute("aria-live", "off"); });
    this.root.append(legend, this.canvas);
    parent.append(this.root);
    this.back = new Backdrop(this.canvas);
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

  /** Envelopes of the window that is chosen, filled anew if another is, or the size is another. */
  fit(span, wide) {
    const { history } = this, now = [span, wide, history.session];
    if (now.every((v, i) => v === this.fitted[i])) return;
    this.fitted = now;
    this.curves = this.signals.map(() => new Envelope(Math.min(span, wide), Math.max(1, span / wide)));
  }

  /** Takes what is new; the first bin that is. The scale follows. */
  take() {
    const { signals, history, curves } = this;
    let first = Infinity, high = signals[0].least ?? -Infinity, low = -high;
    signals.forEach(({ index }, i) => {
      first = Math.min(first, curves[i].take(history.rings[index], history.end));
      for (const v of curves[i].low) if (v < low) low = v;
      for (const v of curves[i].high) if (v > high) high = v;
    });
    if (signals[0].least) low = -(high = Math.max(high, -low)); // what vibrates has no sign: 0 is in the middle
    if (low <= high) this.scale(low, high); else this.scale(0, 0);
    return first;
  }

  draw(fs, seconds, colours) {
    const { canvas, history, back, strip } = this, ratio = devicePixelRatio || 1;
    if (!back.seen) return;
    const box = { x: LEFT, y: TOP, w: canvas.clientWidth - LEFT - RIGHT, h: canvas.clientHeight - TOP - BOTTOM };
    this.fit(Math.min(history.size, Math.round(seconds * fs)), Math.round(box.w * ratio));
    let first = this.take();
    const { top, bottom, blank } = this, { factor, unit } = this.shown();
    const paper = back.changed(seconds, top, bottom, blank, colours, this.curves);
    if (paper) {
      axes(paper.g, box, colours, seconds, bottom * factor, top * factor, unit, blank);
      strip.clear(this.curves[0].columns, Math.round(box.w * ratio), Math.round((box.h + 4) * ratio), ratio);
      first = 0;
    }
    const high = box.h * ratio / (top - bottom), zero = 2 * ratio + high * top;
    const newest = Math.floor((history.end - 1) / this.curves[0].per);
    strip.draw(this.curves, first, newest, v => zero - high * v, colours.curves);
    strip.show(back.show(), Math.round(box.x * ratio), Math.round((box.y - 2) * ratio));
  }

  /** Of a signal that does nothing but vibrate, what vibrates is the same curve: one of the two is left out, `twin`. */
  leaveOut(fs) {
    const [{ index, least, whole }] = this.signals;
    if (!least) return;
    const all = this.history.rms(whole, fs), fast = this.history.rms(index, fs);
    const { root } = this.twin;
    if (all > least) root.hidden = fast > (root.hidden ? 0.98 : 0.995) * all; // what is slow is a tenth of it
  }

  /** Whether nothing has come yet of signals without a known range: any number at the axis would be made up. */
  get blank() { return !this.history.end && this.signals[0].low === undefined; }

  /** In what its values are shown. */
  shown(least = 0) { return scaled(this.signals[0].unit, this.blank ? Infinity : Math.max(Math.abs(this.bottom), Math.abs(this.top), least) * 0.999); }

  /** Takes the rms of what vibrates, of the newest half second. */
  rms(fs) {
    this.fast = this.signals.map(s => { const v = s.least ? this.history.rms(s.index, fs / 2) : 0; return v < s.least ? 0 : v; }); // told with the next picture: legends are of what is drawn
  }

  /** The legend: of the sample that is drawn, also where the curve is out of sight. */
  tell() {
    const { history, signals } = this, all = signals.map((s, i) => (s.least && history.end ? this.fast?.[i] ?? 0 : history.newest(s.index)));
    const { factor, unit } = this.shown(Math.max(...all.map(v => Math.abs(v) || 0)));
    this.values.forEach((v, i) => {
      const text = `${short(all[i] * factor)} ${unit}${signals[i].least ? " rms" : ""}`;
      if (v.textContent !== text) v.textContent = text;
    });
  }
}

/** Of curves over the last seconds, their values from `low` to `high`, without numbers if `blank`. */
function axes(g, box, colours, seconds, low, high, unit, blank) {
  const up = ticks(low, high, Math.max(2, box.h / 34)), across = ticks(-seconds, 0, Math.min(8, box.w / 90));
  frame(g, box, colours, across.at.map(t => [box.x + box.w * (1 + t / seconds), t ? text(t, across.step) : "0 s"]),
    up.at.map(v => [box.y + box.h * (high - v) / (high - low), blank ? "" : text(v, up.step)]), unit);
}

/** The spectrum of one signal: dB over the logarithm of frequency. */
export class Spectrum {
  constructor(canvas, history) {
    Object.assign(this, { canvas, history, mean: null, key: "", peak: -Infinity, at: 0 });
  }

  /** Takes the newest samples of signal `index` if a quarter of a window of new ones has come; whether it has. */
  take(index, fs) {
    const n = lines(fs), { history } = this, key = `${index} ${fs}`;
    if (key !== this.key || history.end < this.at) Object.assign(this, { key, mean: null, at: 0 });
    if (history.end - this.at < n / 4) return false;
    const x = history.last(index, n);
    if (!x) return false;
    this.at = history.end;
    this.mean = smooth(this.mean, density(x, fs), 0.3);
    return true;
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
    const square = unit === "1" || !unit ? "1/Hz" : /[*/]/.test(unit) ? `1 (${pretty(unit)})²/Hz` : `1 ${pretty(unit)}²/Hz`;
    frame(g, box, colours, xs, [0, 20, 40, 60, 80, 100].map(d => [y(top - d), text(top - d, 1)]), "dB");
    g.textAlign = "center";
    g.fillText(`frequency / Hz; dB re ${square}`, box.x + box.w / 2, high - 13);
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

export const isPlace = ({ unit }) => unit === "m" || unit === "rad";

/** Signals in groups that share a panel: places of one unit, named by one letter or alike but for digits (depth1, depth2). */
export function grouped(signals) {
  const groups = new Map();
  for (const s of signals) {
    const stem = s.name.replace(/\d+$/, "");
    const key = isPlace(s) ? `${s.unit} ${stem.length === 1 ? "" : stem}` : `= ${s.name}`;
    groups.set(key, [...groups.get(key) ?? [], s]);
  }
  return [...groups.values()];
}
