// A worker that owns the WebSocket and feeds the audio thread itself, so that a slow or hidden page never starves the sound.
// From the page: {open, token, page}, {audio: MessagePort}, {listen: number of the output}, and whatever the protocol has ({do: ..}).
// To the page: {state: "open" | "lost" | "silent" | "heard" | "refused", code, why, seconds}: lost with the code with which it was closed, {text: what the server said},
// {samples: ArrayBuffer, at: ms}: as they came, and after them what vibrates in each output,
// {played: t of the move that has just been heard, at: ms}, {audio: figures of the audio thread}.

import { Vibration } from "./vibration.js";

const HEAD = 6, VERSION = 1, SILENT = 1500, STALE = 4000, TICK = 250; // ms without a message: it is said; another connection is tried
const REFUSED = [4400, 4401, 4409, 4410, 4429]; // where trying again does not help
let ws = null, audio, url, token, page, tries = 0, up = false, quiet = false, hello = null, output = 0, seen = 0;
let heard = 0, opened = 0, ticked = 0, retry = 0; // ms: last message, last try, last look at both; timer of the next try
let vibration = null, next = -1;
const now = () => performance.timeOrigin + performance.now();

function open() {
  clearTimeout(retry);
  const old = ws, mine = ws = new WebSocket(url);
  old?.close();
  up = false;
  opened = performance.now();
  mine.binaryType = "arraybuffer";
  mine.onopen = () => mine.send(JSON.stringify({ do: "hello", token, version: VERSION, page }));
  mine.onmessage = ({ data }) => {
    if (mine !== ws) return;
    heard = performance.now();
    if (typeof data === "string") text(JSON.parse(data)); else samples(data);
    if (quiet && up) postMessage({ state: "heard" });
    quiet = quiet && !up;
  };
  mine.onclose = ({ code, reason }) => {
    if (mine !== ws) return;
    const refused = REFUSED.includes(code), first = up || !hello; // or of a try to find it again
    up = false;
    ws = null;
    if (refused || first) postMessage({ state: refused ? "refused" : "lost", code, why: reason });
    if (!refused) retry = setTimeout(open, Math.min(1000, 125 * 2 ** tries++));
    else heard = Infinity;
  };
}

/** Whoever waits in vain for a message is told, and tries another connection: a network may have forgotten this one. */
setInterval(() => {
  const late = Math.max(0, performance.now() - ticked - 2 * TICK); // what this thread was late is no silence
  ticked = performance.now();
  heard += late;
  opened += late;
  const silent = ticked - heard, tried = ticked - opened;
  if (hello?.fs && ws && silent > SILENT && (up || quiet)) {
    quiet = true;
    postMessage({ state: "silent", seconds: Math.round(silent / 1000) });
  }
  if (ws && tried > STALE && (!up || (hello.fs && silent > STALE))) open();
}, TICK);

function text(m) {
  if (m.is === "hello") {
    hello = m; up = true; tries = 0;
    vibration = new Vibration(m.fs, m.outputs?.length ?? 0);
    audio?.postMessage({ fs: m.fs });
    postMessage({ state: "open" });
  } else if (m.is === "report") ws.send(JSON.stringify({ do: "seen", at: m.at }));
  else if (m.is === "state") audio?.postMessage({ end: m.phase !== "running" });
  postMessage({ text: m });
}

function samples(data) {
  const head = new Float64Array(data, 0, HEAD), n = head[5], { inputs: { length: of }, outputs: { length: all } } = hello;
  const more = new ArrayBuffer(data.byteLength + 4 * all * n), size = 8 * HEAD;
  new Uint8Array(more).set(new Uint8Array(data));
  new Float32Array(more, data.byteLength).set(new Float32Array(data, size + 4 * of * n));
  for (let k = 0; k < all; k++) vibration.take(new Float32Array(more, data.byteLength + 4 * k * n, n), k, head[0] !== next, head[0] > 0);
  next = head[0] + n;
  if (audio) {
    const y = new Float32Array(more, data.byteLength + 4 * output * n, n).slice();
    audio.postMessage({ y, at: head[0], session: head[4], made: head[3], t: head[1] === seen ? 0 : head[1] }, [y.buffer]);
  }
  seen = head[1];
  postMessage({ samples: more, at: now() }, [more]);
}

onmessage = ({ data: m }) => {
  if (m.open) {
    ({ open: url, token, page } = m);
    heard = performance.now();
    tries = 0;
    open();
  } else if (m.audio) {
    audio = m.audio;
    audio.onmessage = ({ data: d }) => postMessage(d.played ? { ...d, at: now() } : d);
    audio.postMessage({ fs: hello ? hello.fs : 8000 });
  } else if (m.silent) audio = null;
  else if ("listen" in m) output = m.listen;
  else if (m.ask) audio?.postMessage(m);
  else if (up && (m.do !== "move" || ws.bufferedAmount < 65536)) ws.send(JSON.stringify(m)); // a newer move will do
};
