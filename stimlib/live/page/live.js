// The least that drives a scene: a pad, start, stop, sound. The page proper takes its place.
const $ = id => document.getElementById(id), link = new Worker("link.js");
const say = (what, more = {}) => link.postMessage({ do: what, ...more });
let hello, blocks = 0;
link.postMessage({ open: `ws://${location.host}/ws`, token: location.hash.slice(1) });
link.onmessage = ({ data: m }) => {
  if (m.samples) blocks++;
  else if (m.text?.is === "hello") hello = m.text;
  else if (m.text) $("told").textContent = `${blocks} blocks ${JSON.stringify(m.text)}`;
  else if (m.state) $("told").textContent = m.state;
};
const pad = $("pad"), clip = v => Math.min(1, Math.max(0, v));
function move(e, on) {
  const r = pad.getBoundingClientRect();
  say("move", { finger: 0, u: clip((e.clientX - r.left) / r.width), v: clip((r.bottom - e.clientY) / r.height),
    p: e.pressure, on, t: performance.timeOrigin + e.timeStamp });
}
pad.onpointerdown = e => { pad.setPointerCapture(e.pointerId); move(e, 1); };
pad.addEventListener("onpointerrawupdate" in window ? "pointerrawupdate" : "pointermove", e => move(e, e.buttons ? 1 : 0));
pad.onpointerup = pad.onpointercancel = e => move(e, 0);
$("start").onclick = () => say("start");
$("stop").onclick = () => say("stop");
$("sound").onclick = async () => {
  const ctx = new AudioContext({ sampleRate: 48000, latencyHint: "interactive" }), ch = new MessageChannel();
  await ctx.audioWorklet.addModule("worklet.js");
  const node = new AudioWorkletNode(ctx, "player", { numberOfInputs: 0, outputChannelCount: [1], processorOptions: { base: ctx.baseLatency } });
  node.port.postMessage({ port: ch.port1 }, [ch.port1]);
  link.postMessage({ audio: ch.port2 }, [ch.port2]);
  node.connect(ctx.destination);
};
