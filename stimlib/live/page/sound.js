// What is heard: the audio thread's node behind a gain, fed by the worker; how late it is, and how often it had nothing to play.

const SLOW = 20, KEPT = 1000; // Hz, as in worklet.js; latencies that are kept

export class Sound {
  constructor(link) { Object.assign(this, { link, context: null, node: null, gain: null, db: -12, played: [], figures: null }); }

  /** Output k is heard from now on; a sentence on what of it. */
  hear(k, name, full) {
    this.link.postMessage({ listen: k });
    return `You hear ${name}; full scale is ${full}. Its constant part and what is slower than ${SLOW} Hz are left out `
      + "for listening, as no loudspeaker gives them; curves, recordings and devices have all of it.";
  }

  loud(db) {
    this.db = db;
    this.gain?.gain.setTargetAtTime(10 ** (db / 20), this.context.currentTime, 0.02);
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
      this.gain = new GainNode(this.context, { gain: 10 ** (this.db / 20) });
      this.gain.connect(this.context.destination);
    }
    await this.context.resume();
    const { port1, port2 } = new MessageChannel();
    const processorOptions = { base: this.context.baseLatency };
    this.node = new AudioWorkletNode(this.context, "player", { numberOfInputs: 0, outputChannelCount: [1], processorOptions });
    this.node.port.postMessage({ port: port1 }, [port1]);
    this.link.postMessage({ audio: port2 }, [port2]);
    this.node.connect(this.gain);
    return true;
  }

  /** Asks the audio thread for its figures, which come to `told`. */
  ask() { if (this.node) this.link.postMessage({ ask: true }); }

  told({ played, at, audio }) {
    if (played && this.played.push(at - played) > KEPT) this.played.shift();
    if (audio) this.figures = audio;
  }
}
