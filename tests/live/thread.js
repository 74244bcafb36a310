// The audio thread of a shared page without a browser: node thread.js WORKLET '{"rate": .., "o": {..}, "calls": n, "say": {"0": [{..}]}}'
// Its scene gives its inputs back: output k is input k. say: what the page posts before a call of `process`.
// Prints what was heard, which moves the samples had reached when, and the inputs and outputs as they were posted.
"use strict";
const fs = require("fs"), given = JSON.parse(process.argv[3]), MOST = 128;
const { o } = given, inputs = o.inputs.length, memory = { buffer: new ArrayBuffer(8 * MOST * 64) };
const at = { inputs: 0, outputs: 8 * MOST * 16, targets: 8 * MOST * 32 }, row = (part, k, n) => new Float64Array(memory.buffer, at[part] + 8 * MOST * k, n);
const exported = {
  memory, begin() {}, set() {}, fault: () => 0, inputs: () => at.inputs, outputs: () => at.outputs, targets: () => at.targets,
  run(n) { for (let k = 0; k < o.outputs.length; k++) row("outputs", k, n).set(row("inputs", k, n)); },
  follow(n) { for (let k = 0; k < inputs; k++) row("inputs", k, n).set(row("targets", o.held.indexOf(`x${k}`), n)); },
};
let Thread;
Object.assign(globalThis, {
  sampleRate: given.rate, currentFrame: 0, registerProcessor: (_, kind) => { Thread = kind; },
  AudioWorkletProcessor: class { constructor() { this.port = {}; } },
  WebAssembly: { Module: class {}, Instance: class { constructor() { this.exports = exported; } } },
});
(0, eval)(fs.readFileSync(process.argv[2], "utf8"));
const thread = new Thread({ processorOptions: { ...o, motion: Float64Array.from(o.motion) } }), heard = [], rows = Array.from({ length: inputs + o.outputs.length }, () => []);
let ended = 0;
const moved = [], times = [];
thread.port.postMessage = m => {
  if (m.all) rows.forEach((r, k) => r.push(...m.all.subarray(k * m.n, (k + 1) * m.n)));
  if (m.all) times.push(m.t);
  if (m.moved) moved.push(m.moved);
  ended ||= m.ended ?? 0;
};
for (let k = 0; k < given.calls; k++) {
  for (const data of given.say[k] ?? []) thread.port.onmessage({ data });
  const out = new Float64Array(MOST);
  thread.process([], [[out]]);
  heard.push(...out);
}
console.log(JSON.stringify({ heard, rows, ended, moved, times }));
