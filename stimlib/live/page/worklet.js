// The audio thread: a ring of samples at the scene's rate, read at a fractional step by a 4-point Hermite polynomial. The step is
// steered by a PI control so that the ring's mean fill stays at its goal: two clocks never agree, so something must give, and
// here it is at most 0.5 % of pitch.
"use strict";
const SIZE = 1 << 16, MASK = SIZE - 1, FADE = 0.005;
const QUICK = 0.5, LEARNT = QUICK * QUICK / 4; // 1/s, 1/s²: a control that is critically damped; 2000 ppm move the fill by 3 ms

class Player extends AudioWorkletProcessor {
  constructor({ processorOptions: o }) {
    super();
    this.ring = new Float32Array(SIZE);
    this.fs = 8000; this.head = 0; this.at = 0; this.block = 32; this.session = 0; this.next = -1;
    this.base = Math.max(o.base, 128 / sampleRate); // s: the device takes so much at once
    this.depth = this.min = o.depth ?? 2; // blocks in the ring besides
    this.steer = o.steer ?? true;
    this.on = false; this.gain = 0; this.mean = 0; this.sum = 0; this.ratio = 1; this.ended = false;
    this.lost = this.under = this.skips = this.missing = 0; this.least = this.since = Infinity; this.calm = 0; this.n = 0; // since: s of silence since an underrun
    this.marks = [];
    this.port.onmessage = ({ data }) => { this.link = data.port; this.link.onmessage = ({ data: d }) => this.take(d); };
  }

  take(d) {
    if (d.fs) { this.fs = d.fs; return; }
    if ("end" in d) { this.ended = d.end; return; } // a session's end is no gap
    if (d.ask) {
      const { lost, under, skips, missing, mean, ratio, depth, n } = this;
      this.link.postMessage({ audio: { lost, under, skips, missing, fill: mean / this.fs, ratio, depth, n } });
      return;
    }
    if (d.session !== this.session) { this.session = d.session; this.next = d.at; }
    if (d.at !== this.next && this.next >= 0) this.missing += d.at - this.next; // lost by the server: joined, it is told
    this.next = d.at + d.y.length;
    if (d.t && this.marks.length < 64) this.marks.push([this.head, d.t]);
    this.block = Math.max(this.block, d.y.length);
    for (const v of d.y) this.ring[this.head++ & MASK] = v;
    if (this.head - this.at > this.goal() + 8 * this.block + 256 * this.fs / 8000) { // a stall was caught up: begin again near the newest
      if (this.on) { this.skips++; this.since = Infinity; }
      this.on = false;
    }
  }

  goal() { return this.depth * this.block + this.base * this.fs; }

  // Begin only from silence and with so much in the ring that its mean is the goal, as the device begins with the first of what it
  // takes at once; jitter asks for more depth, a stall does not.
  begin(fill, dt) {
    const swing = (this.base - dt) / 2 * this.fs;
    if (fill < this.goal() + swing + 2 || this.gain > 0) {
      if (this.head) this.lost++;
    } else {
      if (this.since < 0.2) this.depth = Math.min(this.depth + 1, 16);
      this.on = true; this.at = this.head - this.goal() - swing;
      this.mean = this.goal();
    }
    this.since += dt;
  }

  control(fill, dt) {
    this.mean += (fill - this.mean) * dt / 0.5;
    this.least = Math.min(this.least, fill);
    if ((this.calm += dt) > 30) { // what grew in a bad moment shrinks again
      if (this.depth > this.min && this.least > 2.5 * this.block + 24) this.depth--;
      this.calm = 0; this.least = Infinity;
    }
    const e = (this.mean - this.goal()) / this.fs; // s too much in the ring
    this.sum = Math.max(-0.004, Math.min(0.004, this.sum + e * dt * LEARNT));
    this.ratio = this.steer ? 1 + Math.max(-0.005, Math.min(0.005, QUICK * e + this.sum)) : 1;
  }

  read() {
    const k = Math.floor(this.at), f = this.at - k, r = this.ring;
    const a = r[(k - 1) & MASK], b = r[k & MASK], c = r[(k + 1) & MASK], d = r[(k + 2) & MASK];
    const m0 = (c - a) / 2, m1 = (d - b) / 2, q = 2 * (b - c) + m0 + m1;
    return b + f * (m0 + f * (c - b - m0 - q + f * q));
  }

  process(_, [[out]]) {
    const n = out.length, dt = n / sampleRate, fill = this.head - this.at, up = 1 / (FADE * sampleRate);
    this.n += n;
    if (!this.on) this.begin(fill, dt);
    if (this.on) this.control(fill, dt);
    const step = this.fs / sampleRate * this.ratio;
    for (let i = 0; i < n; i++) {
      if (this.on && this.head - this.at < 3) { this.on = false; this.under += !this.ended; this.since = this.ended ? Infinity : 0; this.calm = 0; this.least = Infinity; }
      this.gain = this.on ? Math.min(1, this.gain + up) : Math.max(0, this.gain - up);
      out[i] = this.read() * this.gain;
      if (this.on) this.at += step;
    }
    while (this.marks.length && this.marks[0][0] < this.at) this.link.postMessage({ played: this.marks.shift()[1] });
    return true;
  }
}
registerProcessor("player", Player);
