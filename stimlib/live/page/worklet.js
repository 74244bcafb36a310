// The audio thread: a ring of samples at the scene's rate, read at a fractional step by a windowed sinc. The step is
// steered by a PI control so that the ring's mean fill stays at its goal: two clocks never agree, so something must give, and
// here it is at most 0.5 % of pitch.
"use strict";
const SIZE = 1 << 16, MASK = SIZE - 1, FADE = 0.005;
const HALF = 8, PHASES = 256, KERNEL = kernel(7); // taps on either side of a place between samples
const MOST = 0.2, STALL = 0.15; // s: the longest queue; what comes later still is no jitter
const CALM = 30, CALMEST = 960; // s without a gap before the queue shrinks: twice as long after each gap
const QUICK = 0.5, LEARNT = QUICK * QUICK / 4; // 1/s, 1/s²: a control that is critically damped; 2000 ppm move the fill by 3 ms

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
    this.fs = 8000; this.head = 0; this.at = 0; this.block = 32; this.session = 0; this.next = -1;
    this.base = Math.max(o.base, 128 / sampleRate); // s: the device takes so much at once
    this.min = o.depth ?? 2; // blocks in the ring besides
    this.depth = o.depth ?? 8; this.wait = CALM; // at first, as nobody knows how late they come
    this.steer = o.steer ?? true;
    this.on = this.dry = false; this.gain = 0; this.mean = 0; this.sum = 0; this.ratio = 1; this.ended = false;
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
  // takes at once; jitter asks for more depth, as much as was missing, a stall does not.
  begin(fill, dt) {
    const swing = (this.base - dt) / 2 * this.fs;
    if (fill > HALF + 2 && this.dry) { // what was late has come
      this.wait = Math.min(2 * this.wait, CALMEST);
      if (this.since < STALL) this.depth = Math.min(this.depth + Math.ceil(this.since * this.fs / this.block) + 1, Math.floor(MOST * this.fs / this.block));
      this.dry = false;
    }
    if (fill < this.goal() + swing + HALF || this.gain > 0) {
      if (this.head) this.lost++;
    } else {
      this.on = true; this.at = this.head - this.goal() - swing;
      this.mean = this.goal();
    }
    this.since += dt;
  }

  control(fill, dt) {
    this.mean += (fill - this.mean) * dt / 0.5;
    this.least = Math.min(this.least, fill);
    if ((this.calm += dt) > this.wait) { // what grew in a bad moment shrinks again, by half of what nobody needed
      const spare = Math.ceil((this.least - 2.5 * this.block - 24 - HALF) / (2 * this.block));
      if (spare > 0) this.depth = Math.max(this.min, this.depth - spare);
      this.calm = 0; this.least = Infinity;
    }
    const e = (this.mean - this.goal()) / this.fs; // s too much in the ring
    this.sum = Math.max(-0.004, Math.min(0.004, this.sum + e * dt * LEARNT));
    this.ratio = this.steer ? 1 + Math.max(-0.005, Math.min(0.005, QUICK * e + this.sum)) : 1;
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
    const n = out.length, dt = n / sampleRate, fill = this.head - this.at, up = 1 / (FADE * sampleRate);
    this.n += n;
    if (!this.on) this.begin(fill, dt);
    if (this.on) this.control(fill, dt);
    const step = this.fs / sampleRate * this.ratio;
    for (let i = 0; i < n; i++) {
      if (this.on && this.head - this.at < HALF + 1) { this.on = false; this.dry = !this.ended; this.under += !this.ended; this.since = this.ended ? Infinity : 0; this.calm = 0; this.least = Infinity; }
      this.gain = this.on ? Math.min(1, this.gain + up) : Math.max(0, this.gain - up);
      out[i] = this.read() * this.gain;
      if (this.on) this.at += step;
    }
    while (this.marks.length && this.marks[0][0] < this.at) this.link.postMessage({ played: this.marks.shift()[1] });
    return true;
  }
}
registerProcessor("player", Player);
