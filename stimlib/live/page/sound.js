// What is heard: what vibrates in an output, amplified until it is heard; how late it is, and how often it had nothing to play.

import { roundUp, scaled, short } from "./scales.js";

export const LEAST = 2e-5; // of full scale: what is less does not vibrate, half a step of 16 bits
const KEPT = 1000; // latencies
const PARTS = 40, SETTLED = 20, CREST = 8; // windows of 50 ms that count, so many settle it; full scale of the sound in their rms

/** What full scale of the sound is, in the output's unit: it follows the loudest fifth of two seconds, then only rises. */
export class Level {
  constructor({ name, unit, full }) {
    Object.assign(this, { name, unit, device: full, least: LEAST * full, full: 0, peak: 0, parts: [], settled: 0, sum: 0, n: 0 });
  }

  /** Samples at fs Hz in the output's unit; whether the full scale is another now. */
  take(y, fs) {
    for (const v of y)
      if (v === v) { // none after a gap
        this.sum += v * v;
        this.peak = Math.max(this.peak, Math.abs(v));
        this.n++;
      }
    if (this.n < fs / 20) return false;
    const rms = Math.sqrt(this.sum / this.n);
    this.sum = this.n = 0;
    if (rms < this.least) return false;
    this.settled++;
    if (this.parts.push(rms) > PARTS) this.parts.shift();
    const loud = this.parts.slice().sort((a, b) => a - b)[Math.floor(0.8 * this.parts.length)], full = roundUp(CREST * loud);
    if (full <= this.full && this.settled > SETTLED) return false;
    const other = full !== this.full;
    this.full = full;
    return other;
  }

  /** The newest level in dB of full scale. */
  get db() { return 20 * Math.log10(this.peak / (this.full || this.device) + 1e-9); }

  words() {
    const { factor, unit } = scaled(this.unit, this.full), is = `${short(this.full * factor)} ${unit}`.trim();
    const what = `The sound is what vibrates in ${this.name} above 40 Hz`;
    return this.full ? `${what}; full scale of the sound is ${is}, and it never exceeds that.` : `${what}: nothing yet.`;
  }
}

/** Above 0.7 of full scale it bends, and ends at 1 whatever comes. */
const LIMIT = Float32Array.from({ length: 1025 }, (_, k) => {
  const x = k / 256 - 2, high = Math.abs(x);
  return Math.sign(x) * (high < 0.7 ? high : 0.7 + 0.3 * Math.tanh((high - 0.7) / 0.3));
});

export class Sound {
  constructor(link) {
    Object.assign(this, { link, context: null, node: null, gain: null, db: -12, played: [], figures: null, level: null });
    Object.assign(this, { gaps: 0, causes: {}, hidden: false });
    document.addEventListener("visibilitychange", () => { this.hidden = true; }); // nobody asks while it is
  }

  /** Output k is heard from now on, at a level. */
  hear(k, level) {
    this.link.postMessage({ listen: k });
    this.level = level;
  }

  /** So that the full scale of `level` is that of the sound. */
  amplify() {
    const { device, full } = this.level;
    this.amplified?.gain.setTargetAtTime(0.5 * device / (full || device), this.context.currentTime, 0.05);
  }

  loud(db) {
    this.db = db;
    this.gain?.gain.setTargetAtTime(10 ** (db / 20), this.context.currentTime, 0.02);
  }

  /** From what is amplified through the limit and the loudness to the sound card. */
  chain() {
    this.amplified = new GainNode(this.context);
    this.gain = new GainNode(this.context, { gain: 10 ** (this.db / 20) });
    this.amplified.connect(new WaveShaperNode(this.context, { curve: LIMIT })).connect(this.gain).connect(this.context.destination);
  }

  /** On or off; whether it is on now. */
  async toggle() {
    if (this.node) {
      this.link.postMessage({ silent: true });
      this.node.disconnect();
      this.node = null;
      await this.context.suspend();
      return false;
    }
    if (!this.context) {
      this.context = new AudioContext({ sampleRate: 48000, latencyHint: "interactive" });
      await this.context.audioWorklet.addModule("worklet.js");
      this.chain();
    }
    this.context.resume(); // not awaited: it may wait for a click, and `missing` says so
    this.amplify();
    const { port1, port2 } = new MessageChannel();
    const processorOptions = { base: this.context.baseLatency };
    this.node = new AudioWorkletNode(this.context, "player", { numberOfInputs: 0, outputChannelCount: [1], processorOptions });
    this.node.port.postMessage({ port: port1 }, [port1]);
    this.link.postMessage({ audio: port2 }, [port2]);
    this.node.connect(this.amplified);
    this.figures = null;
    return true;
  }

  /** Asks the audio thread for its figures, which come to `told`. */
  ask() { if (this.node) this.link.postMessage({ ask: true }); }

  told({ played, at, audio }) {
    if (played && this.played.push(at - played) > KEPT) this.played.shift();
    if (!audio) return;
    const before = this.figures ?? { under: 0, late: 0, skips: 0 }, late = audio.late - before.late, all = audio.under + audio.skips - before.under - before.skips;
    const near = ["127.0.0.1", "localhost", "[::1]"].includes(location.hostname), other = this.hidden ? "tab hidden" : near ? "browser late" : "network late";
    Object.assign(this, { figures: audio, hidden: false });
    this.gaps += all;
    for (const [cause, n] of [["server late", late], [other, all - late]]) if (n) this.causes[cause] = (this.causes[cause] ?? 0) + n;
  }

  /** Gaps in what was heard, and why. */
  missing() {
    if (this.node && this.context.state !== "running") return ["no sound: the browser waits for a click, or has no sound card"];
    const why = Object.entries(this.causes).map(([cause, n]) => `${cause} ${n}`).join(", ");
    return this.gaps ? [`${this.gaps} in the sound (${why})`] : [];
  }
}
