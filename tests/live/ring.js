// The audio thread of the page without a browser: node ring.js WORKLET '[{"pace": 1, "steer": true, "seconds": 60, ...}, ...]'
// A server whose clock runs `pace` times as fast sends blocks of a sine, `jitter` s late at most; a sound card takes 480
// frames at once. Nothing comes for `lasts` s from `stall` on, or for `hiccup` s every 3 s, `more` each time; then what was `late`,
// in two `halves`, or it is lost; `frozen`: it was not made before. Prints what was heard in the last 5 s, the largest step in all, the counters, and how much is no sine of the
// server's frequency, in dB of the sine: with steer, of the frequency that the step makes of it.
"use strict";
const fs = require("fs"), FS = 8000, BLOCK = 32, RATE = 48000, TAKE = 480;
let Player;
globalThis.sampleRate = RATE;
globalThis.AudioWorkletProcessor = class { constructor() { this.port = {}; } };
globalThis.registerProcessor = (_, kind) => { Player = kind; };
(0, eval)(fs.readFileSync(process.argv[2], "utf8"));

function played(o) {
  const player = new Player({ processorOptions: { base: TAKE / RATE, steer: o.steer, first: o.first } }), link = { postMessage: m => { if (m.audio) counters = m.audio; } };
  let counters, seed = 1, due = 0, k = 0, t = 0, last = 0, step = 0, square = 0, sum = 0, n = 0, peak = 0, phase = 0, c = 0, d = 0, low = 2, high = 0;
  const F = o.f ?? 158, heard = new Float64Array(16 * RATE);
  player.port.onmessage({ data: { port: link } });
  link.onmessage({ data: { fs: FS } });
  const random = () => (seed = (seed * 1103515245 + 12345) % 2147483648) / 2147483648;
  const out = new Float32Array(128);
  for (const end = o.seconds; t < end; t += TAKE / RATE) {
    while (due <= t) {
      const stalled = t > o.stall && t < o.stall + (o.lasts ?? 0.1), halved = o.halves && t < o.stall + o.lasts + 0.04 && k * BLOCK > FS * (o.stall + o.lasts / 2);
      if (!stalled && !halved && !(o.hiccup && t > 3 && t % 3 < o.hiccup + (o.more ?? 0) * Math.floor(t / 3))) {
        const y = new Float32Array(BLOCK);
        for (let i = 0; i < BLOCK; i++) y[i] = 0.25 * Math.sin(2 * Math.PI * F * (k * BLOCK + i) / FS);
        link.onmessage({ data: { y, at: k * BLOCK, session: 1, t: 0, made: o.frozen ? t : k * BLOCK / (FS * o.pace) } });
        k++;
      } else if (!o.late) k++; // lost; else they all come when the stall is over
      else break;
      due = (k + 1) * BLOCK / (FS * o.pace) + o.jitter * random();
    }
    for (let i = 0; i < TAKE; i += 128) {
      const part = out.subarray(0, Math.min(128, TAKE - i));
      player.process([], [[part]]);
      if (t > end - 5) { low = Math.min(low, player.ratio); high = Math.max(high, player.ratio); }
      for (const v of part) {
        if (t > 1) step = Math.max(step, Math.abs(v - last));
        last = v;
        phase += 2 * Math.PI * F / RATE * player.ratio;
        if (t > end - 5) { square += v * v; sum += v; peak = Math.max(peak, Math.abs(v)); heard.set([v, Math.cos(phase), Math.sin(phase)], 3 * n++); }
      }
    }
  }
  link.onmessage({ data: { ask: 1 } });
  for (let i = 0; i < 3 * n; i += 3) { c += 2 * heard[i] * heard[i + 1] / n; d += 2 * heard[i] * heard[i + 2] / n; }
  let rest = 0;
  for (let i = 0; i < 3 * n; i += 3) rest += (heard[i] - c * heard[i + 1] - d * heard[i + 2]) ** 2 / n;
  const distortion = 10 * Math.log10(rest / ((c * c + d * d) / 2)), gain = Math.hypot(c, d) / 0.25;
  return { ...counters, step, rms: Math.sqrt(square / n), mean: sum / n, peak, distortion, gain, wander: high - low };
}

console.log(JSON.stringify(JSON.parse(process.argv[3]).map(played)));
