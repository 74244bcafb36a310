// What a shared page talks to, in the place of the worker of link.js and with its messages: the scene in the audio thread. All that
// the page knows is in its element "shared": text of others gets into the page as text alone.

import { Sound } from "./sound.js";
import { DAMPED, EDGE, Vibration } from "./vibration.js";

const HEAD = 6, RAMP = 0.02, RATE = 48000; // s of a slider's change; Hz of a context where the scene's rate is not allowed
const $ = id => document.getElementById(id);
const epoch = () => performance.timeOrigin + performance.now();

function bytes(base64) { return Uint8Array.from(atob(base64), c => c.charCodeAt(0)); }

/** Rows of doubles from their differences of some order, as whole numbers, in planes of bytes: no bit is lost. */
async function unpacked({ data, order, rows, samples }) {
  const stream = new Blob([bytes(data)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer()), n = rows * samples, all = new Uint8Array(8 * n);
  for (let b = 0; b < 8; b++) for (let i = 0; i < n; i++) all[8 * i + b] = planes[b * n + i];
  const words = new BigInt64Array(all.buffer);
  for (let k = 0; k < order; k++)
    for (let r = 0; r < rows; r++)
      for (let i = r * samples + 1; i < (r + 1) * samples; i++) words[i] += words[i - 1];
  return new Float64Array(all.buffer);
}

const hex = buffer => Array.from(new Uint8Array(buffer), b => b.toString(16).padStart(2, "0")).join("");

/** The scene, as a server of one page. */
class Scene {
  constructor(shared) {
    const rate = shared.hello.fs < 8000 || shared.hello.fs > 96000 ? RATE : shared.hello.fs; // worklet.js has the same
    Object.assign(this, { shared, hello: { ...shared.hello, behind: [1 / 60 + 128 / rate + 0.005, 1 / (8 * Math.PI)] }, sources: shared.sources, phase: "idle", session: 0, why: "", heard: 0, recorded: "" });
    this.params = Object.fromEntries(this.hello.params.map(({ name, value }) => [name, value]));
    this.code = `data:text/javascript,${encodeURIComponent($("worklet").textContent)}`; // Chromium takes no blob: here from disk
    this.motion = shared.motion ? unpacked(shared.motion) : Promise.resolve(new Float64Array(0));
  }

  text(text) { this.onmessage({ data: { text } }); }

  state() {
    const { phase, session, sources, params, why, recorded } = this;
    this.text({ is: "state", role: "control", controlled: true, log: null, phase, session, sources, params, why, recorded });
  }

  /** A message of the page. */
  postMessage(m) {
    if (m.open) setTimeout(() => { this.text({ is: "hello", ...this.hello }); this.state(); });
    else if ("listen" in m) this.tell({ listen: this.heard = m.listen });
    else this[m.do]?.(m);
  }

  tell(message) { this.node?.port.postMessage(message); }

  move(m) { this.tell({ move: m }); }

  number(name) { return this.hello.params.findIndex(p => p.name === name); }

  set({ name, value }) {
    this.params[name] = value;
    this.tell({ set: [this.number(name), value, Math.max(1, Math.round(RAMP * this.hello.fs))] });
  }

  source({ input, ...chosen }) {
    const { do: _, ...fields } = chosen;
    this.sources = { ...this.sources, [input]: { ...this.sources[input], ...fields } };
    this.recorded = "";
    this.tell({ choose: this.sources });
    this.state();
  }

  start() { return this.begin(this.sources); }

  /** The recorded motion, from its first sample, in all inputs. */
  record() { return this.begin(this.given(), "The recorded motion drives all inputs."); }

  given() { return Object.fromEntries(Object.entries(this.sources).map(([name, s]) => [name, { ...s, from: "given" }])); }

  async begin(sources, recorded = "") {
    if (this.phase !== "idle" && this.phase !== "running") return;
    this.phase = "running";
    this.session++;
    this.clips = {};
    this.why = "";
    this.recorded = recorded;
    this.vibration = new Vibration(this.hello.fs, this.hello.outputs.length);
    this.next = 0;
    try {
      await this.load();
    } catch (e) {
      this.phase = "idle";
      this.why = `This browser cannot run it: ${e.message}`;
      return this.state();
    }
    this.context.resume(); // not awaited: it may wait for a click
    const params = Object.entries(this.params).map(([name, value]) => [this.number(name), value, 1]);
    const moved = params.filter(([k, value]) => value !== this.hello.params[k].value);
    this.tell({ start: { params: moved, sources, session: this.session } });
    this.state();
  }

  stop() {
    if (this.phase !== "running") return;
    this.phase = "stopping";
    this.tell({ stop: true });
    this.state();
  }

  async options() {
    const { fs, inputs, outputs } = this.hello;
    return {
      fs, wasm: bytes(this.shared.wasm), inputs: inputs.map(i => i.name), outputs: outputs.map(o => o.full),
      held: this.shared.held, lifted: this.shared.lifted, motion: await this.motion, samples: this.shared.samples, sources: this.sources,
    };
  }

  async worklet(context, more = {}) {
    if (!context.audioWorklet) throw new Error("it has no AudioWorklet here; open the page from disk, or by https");
    await context.audioWorklet.addModule(this.code);
    return new AudioWorkletNode(context, "scene", { numberOfInputs: 0, outputChannelCount: [1], processorOptions: { ...await this.options(), ...more } });
  }

  /** Makes the audio thread, once. */
  load() {
    return this.loaded ??= (async () => {
      const { fs } = this.hello;
      let context;
      try { context = new AudioContext({ sampleRate: fs, latencyHint: "interactive" }); }
      catch { context = new AudioContext({ sampleRate: RATE, latencyHint: "interactive" }); }
      this.context = context;
      context.resume(); // while the click is still young
      this.node = await this.worklet(context);
      this.node.port.onmessage = ({ data }) => this.take(data);
      this.tell({ listen: this.heard });
      this.sound.attach(this.node, context, fs);
    })();
  }

  /** From the audio thread. */
  take({ all, n, first, session, t, moved, frame, ended, fault }) {
    if (moved) {
      const { contextTime, performanceTime } = this.context.getOutputTimestamp();
      if (performanceTime) this.onmessage({ data: { played: moved, at: performance.timeOrigin + performanceTime + 1e3 * (frame / this.context.sampleRate - contextTime) } });
    } else if (ended) {
      if (ended !== this.session) return; // one that began since
      this.recorded = this.phase === "stopping" || fault ? "" : "The recorded motion has ended.";
      this.why = fault ? `Not finite: ${this.hello.outputs[fault - 1].name}. It was faded out.` : "";
      this.phase = "idle";
      this.state();
    } else if (session === this.session) this.samples(all, n, first, t);
  }

  /** As link.js gives them: in full scale, and after them what vibrates in each output. */
  samples(all, n, first, t) {
    const { fs, inputs: { length: of }, outputs } = this.hello, rows = of + 2 * outputs.length;
    const data = new ArrayBuffer(8 * HEAD + 4 * rows * n), y = new Float32Array(data, 8 * HEAD);
    new Float64Array(data, 0, HEAD).set([first, t, 0, 0, this.session, n]);
    this.tap?.(all, n, first);
    y.set(all);
    outputs.forEach(({ name, full }, k) => {
      const row = y.subarray((of + k) * n, (of + k + 1) * n), vibrates = y.subarray((of + outputs.length + k) * n, (of + outputs.length + k + 1) * n);
      for (let i = 0; i < n; i++) row[i] /= full;
      if (row.some(v => Math.abs(v) > 1)) this.clips[name] = { full: (this.clips[name]?.full ?? 0) + 1 };
      vibrates.set(row);
      this.vibration.take(vibrates, k, first === 0);
    });
    this.onmessage({ data: { samples: data, at: epoch() } });
    if (first >= this.next) {
      this.text({ is: "report", session: this.session, at: first + n, seconds: (first + n) / fs, lost: 0, underruns: 0, late: 0, skipped: 0, clips: this.clips, faults: {} });
      this.next = first + fs / 5;
    }
  }

  /** The samples of the recorded motion, computed by the audio thread without sound: {sha256, spent: ms in 128 samples}. */
  async check(changes = []) {
    const { samples } = this.shared;
    const context = new OfflineAudioContext(1, 128 * (Math.ceil(samples / 128) + changes.length + 1), RATE);
    const node = await this.worklet(context, { check: changes, sources: this.given() });
    const made = new Promise(resolve => { node.port.onmessage = ({ data }) => resolve(data); });
    node.connect(context.destination);
    await context.startRendering();
    const { all, spent } = await made;
    return { all, spent, sha256: hex(await crypto.subtle.digest("SHA-256", all)) };
  }
}

/** It is heard where the scene runs: on and off are a matter of loudness. */
class SceneSound extends Sound {
  attach(node, context, fs) {
    this.context = context;
    this.chain();
    this.open = new GainNode(context, { gain: 0 });
    this.made = node;
    DAMPED.reduce((before, q) => before.connect(new BiquadFilterNode(context, { type: "highpass", frequency: Math.min(EDGE, fs / 8), Q: 20 * Math.log10(q) })), node)
      .connect(this.open).connect(this.amplified);
    if (this.level) this.amplify();
  }

  async toggle() {
    await this.link.load();
    const on = !this.node;
    this.node = on ? this.made : null;
    this.context.resume();
    this.open.gain.setTargetAtTime(Number(on), this.context.currentTime, 0.01);
    return on;
  }

  ask() {}

  missing() {
    const waits = this.context && this.link.phase === "running" && this.context.state !== "running";
    return waits ? ["all stands still: the browser waits for a click, or has no sound card, whose clock drives the scene"] : [];
  }
}

function element(parent, tag, textContent = "") { return Object.assign(parent.appendChild(document.createElement(tag)), { textContent }); }

/** What this page is, and whether this browser computes what was written. */
function identity(scene) {
  const { cite, facts, sha256, samples, hello: { fs } } = scene.shared, section = document.createElement("section");
  section.id = "identity";
  section.setAttribute("aria-labelledby", "h-identity");
  element(section, "h2", "What this page is").id = "h-identity";
  const list = element(section, "dl");
  list.className = "facts";
  element(list, "dt", "to cite").hidden = !cite;
  element(list, "dd", cite).hidden = !cite;
  for (const [name, value] of facts) { element(list, "dt", name); element(list, "dd", value); }
  document.querySelector(".wide").append(section);
  if (!sha256) {
    element(section, "p", "It was made without a recorded motion, so there are no samples to check.").className = "hint";
    return;
  }
  const said = element(section, "p", `Computing the ${samples} samples of the recorded motion ..`);
  said.id = "checked";
  said.setAttribute("role", "status");
  scene.checked = scene.check().then(made => {
    const same = made.sha256 === sha256, block = 128 / fs * 1e3;
    said.className = same ? "good" : "bad";
    said.textContent = same ? `Computed in this browser: all ${samples} samples are those of stimlib, bit for bit.`
      : `Computed in this browser, the samples differ: their SHA-256 is ${made.sha256}.`;
    element(section, "p", `128 samples take ${made.spent.toFixed(3)} ms of ${block.toFixed(1)} ms in its audio thread.`).className = "hint";
    return { same, sha256: made.sha256, spent: made.spent, block };
  }, e => {
    said.className = "bad";
    said.textContent = `This browser cannot run it: ${e.message}`;
  });
}

export function connected() {
  const scene = globalThis.scene = new Scene(JSON.parse($("shared").textContent));
  scene.sound = new SceneSound(scene);
  $("records").textContent = scene.shared.motion ? ", R plays the recorded motion" : "";
  identity(scene);
  return { link: scene, sound: scene.sound };
}
