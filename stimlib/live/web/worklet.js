// The audio thread of a shared page: the scene as WebAssembly, driven by fingers, sines or the recorded motion. What is heard is
// one output at the scene's rate; a context of another rate reads it at a fractional step by a 4-point Hermite polynomial.
"use strict";
const MOST = 128, RING = 1024, MASK = RING - 1, FINGERS = 10, KEPT = 128; // reports of a finger
const APART = 1 / 60, LATE = 0.005, CATCH_UP = 0.15, CHANGE = 0.1, FADE = 0.02; // s: between reports; that one is late; inputs.py; of the sound
const WINDOW = 1; // s over which two clocks are compared
const now = () => (globalThis.performance ?? Date).now();
const POINTERS = { u: 1, v: 2, pressure: 3 };

/** The offset of another clock, from times that arrive late by varying amounts, as in inputs.py. */
class Clock {
  before = Infinity;
  least = Infinity;
  until = -Infinity;

  offset(then, at) {
    if (at > this.until) {
      this.before = at < this.until + WINDOW ? this.least : Infinity;
      Object.assign(this, { least: Infinity, until: at + WINDOW });
    }
    this.least = Math.min(this.least, at - then);
    return Math.min(this.before, this.least);
  }
}

class Scene extends AudioWorkletProcessor {
  constructor({ processorOptions: o }) {
    super();
    Object.assign(this, o); // fs, wasm, inputs (names), outputs (full scales), held (names), lifted (names of forces), motion (rows), check, sources
    const { exports: e } = new WebAssembly.Instance(new WebAssembly.Module(o.wasm)), rows = [o.inputs.length + 1, o.outputs.length];
    const view = (at, n) => new Float64Array(e.memory.buffer, at, MOST * n);
    this.run = e;
    this.x = view(e.inputs(), rows[0]);
    this.y = view(e.outputs(), rows[1]);
    if (e.targets) this.targets = view(e.targets(), o.held.length);
    this.length = o.motion.length / (o.inputs.length || 1);
    this.on = false;
    this.ring = new Float64Array(RING);
    this.heard = this.wanted = this.gain = this.session = 0;
    this.fingers = Array.from({ length: FINGERS }, () => [[-Infinity, 0, 0, 0, 0]]); // reports: s of the samples, u, v, p, on
    this.delay = APART + MOST / sampleRate + LATE; // so that the next report has come when a block of samples is made
    this.clock = new Clock();
    this.moves = [];
    this.made = 0; // samples of all sessions
    this.plain = new Float64Array(MOST * o.inputs.length); // ahead of the smoothing
    this.jumps = new Float64Array(MOST * o.inputs.length); // at landings, which are not smoothed
    this.size = Math.max(MOST, Math.ceil(o.fs / 100)); // of what is posted at once
    this.rows = o.inputs.length + o.outputs.length;
    this.pack = new Float64Array(this.rows * (this.size + MOST));
    this.choose(o.sources);
    if (o.check) Object.assign(this, { all: new Float64Array(o.outputs.length * o.samples), spent: 0, calls: 0 });
    this.begin([]);
    this.port.onmessage = ({ data: d }) => {
      for (const [what, given] of Object.entries(d)) this[what](given);
    };
  }

  // From the page ------------------------------------------------------------------------------------------------------
  begin(params) {
    Object.assign(this, { at: 0, head: 3, place: 1, quiet: 0, packed: 0, first: 0, fault: 0, stopping: false });
    this.ring.fill(0);
    this.last = this.inputs.map(() => 0);
    this.changed = this.inputs.map(() => -Infinity);
    this.from = this.inputs.map(() => 0);
    this.ways = this.inputs.map(() => ({ end: null, jumps: 0 }));
    this.run.begin();
    for (const p of params) this.set(p);
  }

  /** A new session, after the one that runs has faded out. */
  start(next) {
    if (this.on) { Object.assign(this, { next, stopping: true }); return; }
    const { params, sources, session } = next;
    this.choose(sources);
    this.begin(params);
    this.session = session;
    this.gain = 0;
    this.on = true;
  }

  /** Also of a session that waits for the one before: that ends in its name. */
  stop() { Object.assign(this, { session: this.next?.session ?? this.session, next: null, stopping: true }); }
  listen(k) { this.wanted = k; }
  set([parameter, value, samples]) { this.run.set(parameter, value, samples); }

  choose(sources) {
    const before = this.chosen;
    this.chosen = this.inputs.map(name => sources[name]);
    this.touches = this.chosen.some(({ from }) => from === "contact" || from === "pressure");
    this.chosen.forEach((s, k) => {
      if (!before || JSON.stringify(s) === JSON.stringify(before[k])) return;
      this.changed[k] = this.at;
      this.from[k] = this.last[k];
      this.ways[k].end = null;
    });
  }

  /** A finger is there a delay later, on a line from its last report; where it lands it is at once. */
  move({ finger, u, v, p, on, t }) {
    const reports = this.fingers[finger], before = reports.at(-1), now = this.made / this.fs;
    const at = t / 1e3 + this.clock.offset(t / 1e3, now), held = this.touches && on !== before[4] ? at : at - CATCH_UP;
    if (held > before[0]) reports.push([held - 1e-6, ...before.slice(1)]);
    reports.push([Math.max(at, before[0]), ...(this.touches && !on ? before.slice(1, 3) : [u, v]), on ? p : 0, on]);
    reports.splice(0, reports.length - KEPT);
    this.moves.push([at, t]);
    this.moves.splice(0, this.moves.length - KEPT);
  }

  // Samples ------------------------------------------------------------------------------------------------------------
  /** What the smoothing follows for input k, a finger or a value, as in inputs.py: it never jumps, but catches up. */
  target(k, n) {
    const { from, finger, low, high, value } = this.chosen[k], reports = this.fingers[finger], axis = POINTERS[from], way = this.ways[k];
    const begin = MOST * this.held.indexOf(`x${k}`), length = CATCH_UP * this.fs;
    const zero = this.touches && from !== "contact" && this.lifted.includes(this.inputs[k]); // while its finger is lifted
    const lands = this.touches && axis && from !== "pressure" && !zero;
    let j = 0, x = value, on = 1;
    const go = i => {
      const t = (this.made + i) / this.fs - this.delay;
      while (reports[j + 1]?.[0] <= t) j++;
      const a = reports[j], b = reports[j + 1] ?? a, part = b[0] - a[0] < Infinity && b !== a ? Math.max(0, (t - a[0]) / (b[0] - a[0])) : 0;
      if (lands) on = a[4];
      x = axis ? low + (high - low) * (a[axis] + part * (b[axis] - a[axis])) : from === "contact" ? a[4] : value;
      if (zero) x *= a[4];
    };
    go(-1);
    let { end, touched, last, jumps, late } = way.end === null ? { ...way, end: x, touched: on, last: x, late: [] } : way;
    late = late.filter(([since]) => this.made - since < length);
    if (end !== x && axis) late.push([this.made, end - x]);
    for (let i = 0; i < n; i++) {
      go(i);
      if (on > touched) {
        jumps += x - last;
        late = [];
      }
      last = x;
      for (const [since, jump] of late) {
        const part = Math.min(1, (this.made + i + 1 - since) / length);
        last += jump * (1 - part) ** 2 * (1 + 2 * part);
      }
      touched = on;
      this.plain[k * MOST + i] = x;
      this.jumps[k * MOST + i] = jumps;
      this.targets[begin + i] = last - jumps;
    }
    this.ways[k] = { end: x, touched, last, jumps, late };
  }

  /** What is not smoothed: contact, a sine, the recorded motion; and a change from one source to another. */
  direct(k, n) {
    const { from, low, high, freq } = this.chosen[k], row = this.x.subarray(k * MOST, k * MOST + n), { at } = this;
    if (from === "contact") row.set(this.plain.subarray(k * MOST, k * MOST + n));
    else if (from === "sine")
      for (let i = 0; i < n; i++) row[i] = (low + high - (high - low) * Math.cos(2 * Math.PI * freq * (at + i) / this.fs)) / 2;
    else if (from === "given") for (let i = 0; i < n; i++) row[i] = this.motion[k * this.length + Math.min(at + i, this.length - 1)];
    const since = at - this.changed[k], length = CHANGE * this.fs;
    if (since < length && from !== "contact")
      for (let i = 0; i < n; i++) row[i] = this.from[k] + Math.min(1, (since + 1 + i) / length) * (row[i] - this.from[k]);
    this.last[k] = row[n - 1];
  }

  make(n) {
    if (this.targets) {
      for (let k = 0; k < this.inputs.length; k++) this.target(k, n);
      this.run.follow(n);
      this.jumps.forEach((v, i) => { this.x[i] += v; });
    }
    for (let k = 0; k < this.inputs.length; k++) this.direct(k, n);
    this.run.run(n);
    this.at += n;
    this.made += n;
  }

  /** The samples of the recorded motion alone, with changes [sample, parameter, value, samples], for their hash. */
  checked() {
    const { check, samples, outputs, y } = this, first = this.at, begun = now();
    let n = Math.min(MOST, samples - first);
    for (const [at, ...p] of check)
      if (at === first) this.set(p);
      else if (at > first) n = Math.min(n, at - first);
    this.make(n);
    this.spent += now() - begun;
    this.calls += n / MOST;
    outputs.forEach((_, k) => this.all.set(y.subarray(k * MOST, k * MOST + n), k * samples + first));
    if (this.at < samples) return true;
    this.port.postMessage({ all: this.all, spent: this.spent / this.calls }, [this.all.buffer]);
    return false;
  }

  post() {
    const { packed: n, rows, session, first } = this, all = new Float64Array(rows * n);
    for (let k = 0; k < rows; k++) all.set(this.pack.subarray(k * (this.size + MOST), k * (this.size + MOST) + n), k * n);
    this.port.postMessage({ all, n, first, session, t: this.seen ?? 0 }, [all.buffer]);
    this.first += n;
    this.packed = 0;
  }

  /** Samples of the recorded motion that are still to come, if it drives an input. */
  left() { return this.length && this.chosen.some(s => s.from === "given") ? this.length - this.at : Infinity; }

  /** One more block: into the ring of what is heard, and to the page. The recorded motion ends with its last sample: to hold its
   *  last position would be a sudden stop, and a vibration that no hand made. The sound has faded out by then. */
  more(most) {
    const { x, y, inputs, outputs, size } = this, n = Math.min(most, this.left());
    if (n <= 0) {
      this.stopping = true;
      for (let i = 0; i < most; i++, this.head++) this.ring[this.head & MASK] = this.ring[(this.head - 1) & MASK];
      return;
    }
    this.make(n);
    for (let k = 0; k < this.rows; k++) {
      const [from, i] = k < inputs.length ? [x, k] : [y, k - inputs.length];
      this.pack.set(from.subarray(i * MOST, i * MOST + n), k * (size + MOST) + this.packed);
    }
    for (let i = 0; i < n; i++) this.ring[this.head++ & MASK] = y[this.heard * MOST + i] / outputs[this.heard];
    let moved = 0;
    while (this.moves[0]?.[0] <= this.made / this.fs - this.delay) [, moved] = this.moves.shift();
    if (moved) {
      this.port.postMessage({ moved, frame: currentFrame });
      this.seen = moved;
    }
    if ((this.packed += n) >= size) this.post();
    this.fault = this.run.fault(); // of an output that fades out, plus 1
    this.stopping ||= this.fault > 0;
  }

  read() {
    const k = Math.floor(this.place), f = this.place - k, r = this.ring;
    const a = r[(k - 1) & MASK], b = r[k & MASK], c = r[(k + 1) & MASK], d = r[(k + 2) & MASK];
    const m0 = (c - a) / 2, m1 = (d - b) / 2, q = 2 * (b - c) + m0 + m1;
    return b + f * (m0 + f * (c - b - m0 - q + f * q));
  }

  process(_, [[out]]) {
    if (this.check) return this.checked();
    if (!this.on) return true;
    const step = this.fs / sampleRate, up = 1 / (FADE * sampleRate), fade = this.left() + this.at - FADE * this.fs;
    for (let i = 0; i < out.length; i++) {
      if (this.place >= fade) this.stopping = true;
      // as many samples as this call still needs, so that a context of the scene's rate takes whole blocks
      while (this.head - this.place < 3) this.more(Math.min(MOST, Math.max(1, Math.ceil((out.length - i) * step))));
      this.gain = Math.min(1, Math.max(0, this.gain + (this.stopping || this.heard !== this.wanted || this.place <= this.quiet ? -up : up)));
      if (this.gain === 0 && this.heard !== this.wanted) Object.assign(this, { heard: this.wanted, quiet: this.head }); // the ring still has the other one
      out[i] = this.read() * this.gain;
      this.place += step;
    }
    if (this.stopping && this.gain === 0) {
      this.on = false;
      if (this.left() <= FADE * this.fs) while (this.left() > 0) this.more(MOST); // of the recording, none is missing
      if (this.packed) this.post();
      this.port.postMessage({ ended: this.session, fault: this.fault });
      if (this.next) this.start(this.next);
      this.next = null;
    }
    return true;
  }
}
registerProcessor("scene", Scene);
