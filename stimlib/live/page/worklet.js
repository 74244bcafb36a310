// The audio thread: a ring of samples at the scene's rate, read at a fractional step by a windowed sinc. The step is
// steered by a PI control so that the ring's mean fill stays at its goal: two clocks never agree, so something must give, and
// here it is at most 0.5 % of pitch. The goal follows how late blocks come, before one is too late.
"use strict";
const SIZE = 1 << 17, MASK = SIZE - 1, FADE = 0.005;
const HALF = 8, PHASES = 256, KERNEL = kernel(7); // taps on either side of a place between samples
const LEAST = 0.04, FIRST = 0.1, MOST = 0.4; // s of queue: the shortest, the first while lateness is unknown, the longest
const KNOWN = 10, MARGIN = 1.5, KEPT = 120, LONGEST = 960; // s until it is known; times the largest lateness; s it is kept, twice as long after each gap
const WINDOW = 1, EXCESS = 0.25; // s in which some block is not late; s of queue too much that are left out
const QUICK = 0.5, LEARNT = QUICK * QUICK / 4, STEEP = 0.005; // 1/s, 1/s²: a control that is critically damped; 2000 ppm move the fill by 3 ms

/** Taps of a sinc under a Kaiser window, for each phase and the one after the last: images below -70 dB up to a third of the rate. */
function kernel(beta) {
  const bessel = x => { let sum = 1, part = 1; for (let k = 1; k < 40; k++) sum += part *= (x / (2 * k)) ** 2; return sum; };
  return Float32Array.from({ length: 2 * HALF * (PHASES + 1) }, (_, i) => {
    const d = i % (2 * HALF) - HALF + 1 - Math.floor(i / (2 * HALF)) / PHASES, u = d / HALF;
    return (d ? Math.sin(Math.PI * d) / (Math.PI * d) : 1) * (Math.abs(u) < 1 ? bessel(beta * Math.sqrt(1 - u * u)) / bessel(beta) : 0);
  });
}

class Player extends AudioWorkletProcessor {
  constructor({ processorOptions: o }) {
    super();
    this.ring = new Float32Array(SIZE);
    this.fs = 8000; this.head = 0; this.at = 0; this.session = 0; this.next = -1;
    this.base = Math.max(o.base, 128 / sampleRate); // s: the device takes so much at once
    this.first = o.first ?? FIRST; this.depth = this.first; this.need = 0; this.keep = KEPT; // s of queue besides; largest lateness, and for how long
    this.steer = o.steer ?? true;
    this.on = this.dry = this.stood = this.ended = false; this.gain = 0; this.mean = 0; this.sum = 0; this.ratio = 1;
    this.under = this.late = this.skips = this.missing = 0; this.n = 0; // late: gaps of the server
    this.time = 0; this.best = this.before = -Infinity; this.until = 0; // s of the card's clock, and by how much blocks were ahead of it
    this.begun = this.came = this.made = this.waited = 0; this.heard = Infinity; // s, when the sound began, the newest block came, and the first; s of the server's clock when it was made
    this.marks = [];
    this.port.onmessage = ({ data }) => { this.link = data.port; this.link.onmessage = ({ data: d }) => this.take(d); };
  }

  take(d) {
    if (d.fs) { this.fs = d.fs; return; }
    if ("end" in d) { this.ended = d.end; return; } // a session's end is no gap
    if (d.ask) {
      const { under, late, skips, missing, mean, ratio, depth, n } = this;
      this.link.postMessage({ audio: { under: under - (this.waited > 0), late, skips, missing, fill: mean, ratio, depth, n } });
      return;
    }
    if (d.session !== this.session) Object.assign(this, { session: d.session, next: d.at, best: -Infinity, before: -Infinity, dry: false });
    if (d.at !== this.next && this.next >= 0) this.join(d);
    this.next = d.at + d.y.length;
    this.learn(d);
    if (d.t && this.marks.length < 64) this.marks.push([this.head, d.t]);
    for (const v of d.y) this.ring[this.head++ & MASK] = v;
    const same = this.time - this.begun < 1; // the gap before is not over yet
    if (this.on && this.fill() > this.goal() + (same ? EXCESS / 5 : EXCESS)) { // a stall was caught up: begin again near the newest
      this.skips += !same;
      this.on = false;
    }
  }

  /** Samples were lost by the server, which counts them: what is before them fades out, what comes after them fades in. */
  join({ at, y }) {
    this.missing += at - this.next;
    const n = Math.min(Math.floor(FADE * this.fs), y.length), left = Math.min(n, Math.floor(this.head - this.at) - 2 * HALF);
    for (let k = 0; k < left; k++) this.ring[(this.head - 1 - k) & MASK] *= k / left;
    for (let k = 0; k < n; k++) y[k] *= k / n;
  }

  /** How late a block is, against the earliest of the last one or two seconds; and whose gap it ends. */
  learn({ at, made = 0 }) {
    const ahead = at / this.fs - this.time;
    this.heard = Math.min(this.heard, this.time);
    if (this.time > this.until) Object.assign(this, { before: this.time < this.until + WINDOW ? this.best : -Infinity, best: -Infinity, until: this.time + WINDOW });
    this.best = Math.max(this.best, ahead);
    const late = Math.max(this.before, this.best) - ahead - this.base;
    this.stood = late > MOST || this.stood && late > 0; // no queue bridges that, nor has to hold what is caught up
    if (!this.stood) this.need = Math.max(this.need, late);
    if (this.dry) {
      this.dry = false;
      this.under++;
      this.waited = this.time - this.came;
      this.keep = Math.min(2 * this.keep, LONGEST);
    }
    if (made - this.made > this.waited / 2) { // of the blocks that come now, the first may have been made before the server stood still
      this.late += this.waited > 0;
      this.waited = 0;
    }
    [this.came, this.made] = [this.time, made];
  }

  fill() { return (this.head - this.at) / this.fs; }

  goal() { return this.depth + this.base; }

  // Begin only from silence and with so much in the ring that its mean is the goal, as the device begins with the first of what it
  // takes at once.
  begin(dt) {
    const wanted = this.goal() + (this.base - dt) / 2;
    if (this.gain > 0 || this.dry || !this.head || this.fill() < wanted + HALF / this.fs) return;
    Object.assign(this, { on: true, at: this.head - wanted * this.fs, mean: this.goal(), begun: this.time, waited: 0 });
  }

  control(dt) {
    this.mean += (this.fill() - this.mean) * dt / 0.5;
    const e = this.mean - this.goal(), wanted = QUICK * e + this.sum; // s too much in the ring
    if (Math.abs(wanted) < STEEP) this.sum = Math.max(-0.004, Math.min(0.004, this.sum + e * dt * LEARNT));
    this.ratio = this.steer ? 1 + Math.max(-STEEP, Math.min(STEEP, wanted)) : 1;
  }

  read() {
    const k = Math.floor(this.at), p = (this.at - k) * PHASES, i = Math.floor(p), f = p - i;
    let y = 0;
    for (let j = 0, a = 2 * HALF * i; j < 2 * HALF; j++, a++) {
      y += this.ring[(k + 1 - HALF + j) & MASK] * (KERNEL[a] + f * (KERNEL[a + 2 * HALF] - KERNEL[a]));
    }
    return y;
  }

  process(_, [[out]]) {
    const n = out.length, dt = n / sampleRate, up = 1 / (FADE * sampleRate);
    this.n += n;
    this.time += dt;
    this.need *= 1 - dt / this.keep;
    this.depth = Math.min(MOST, Math.max(this.time - this.heard < KNOWN ? this.first : LEAST, MARGIN * this.need));
    if (!this.on) this.begin(dt);
    if (this.on) this.control(dt);
    const step = this.fs / sampleRate * this.ratio;
    for (let i = 0; i < n; i++) {
      if (this.on && this.head - this.at < HALF + 1) { this.on = false; this.dry = !this.ended; }
      this.gain = this.on ? Math.min(1, this.gain + up) : Math.max(0, this.gain - up);
      out[i] = this.read() * this.gain;
      if (this.on) this.at += step;
    }
    while (this.marks.length && this.marks[0][0] < this.at) this.link.postMessage({ played: this.marks.shift()[1] });
    return true;
  }
}
registerProcessor("player", Player);
