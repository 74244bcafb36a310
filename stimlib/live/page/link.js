// A worker that owns the WebSocket and feeds the audio thread itself, so that a slow or hidden page never starves the sound.
// From the page: {open, token}, {audio: MessagePort}, {listen: number of the output}, and whatever the protocol has ({do: ..}).
// To the page: {state: "open" | "lost" | "refused", code, why}, {text: what the server said}, {samples: ArrayBuffer, at: ms},
// {played: t of the move that has just been heard, at: ms}, {audio: figures of the audio thread}.
"use strict";
const HEAD = 6, VERSION = 1;
let ws, audio, url, token, tries = 0, up = false, hello = null, output = 0, seen = 0;
const now = () => performance.timeOrigin + performance.now();

function open() {
  ws = new WebSocket(url);
  ws.binaryType = "arraybuffer";
  ws.onopen = () => ws.send(JSON.stringify({ do: "hello", token, version: VERSION }));
  ws.onmessage = ({ data }) => (typeof data === "string" ? text(JSON.parse(data)) : samples(data));
  ws.onclose = ({ code, reason }) => {
    up = false;
    const refused = code >= 4400 && code < 4500;
    postMessage({ state: refused ? "refused" : "lost", code, why: reason });
    if (!refused) setTimeout(open, Math.min(1000, 125 * 2 ** tries++));
  };
}

function text(m) {
  if (m.is === "hello") {
    hello = m; up = true; tries = 0;
    audio?.postMessage({ fs: m.fs });
    postMessage({ state: "open" });
  } else if (m.is === "report") ws.send(JSON.stringify({ do: "seen", at: m.at }));
  postMessage({ text: m });
}

function samples(data) {
  const head = new Float64Array(data, 0, HEAD), n = head[5], row = hello.inputs.length + output;
  if (audio) {
    const y = new Float32Array(data, 8 * HEAD + 4 * row * n, n).slice();
    audio.postMessage({ y, at: head[0], session: head[4], t: head[1] === seen ? 0 : head[1] }, [y.buffer]);
  }
  seen = head[1];
  postMessage({ samples: data, at: now() }, [data]);
}

onmessage = ({ data: m }) => {
  if (m.open) { url = m.open; token = m.token; open(); }
  else if (m.audio) {
    audio = m.audio;
    audio.onmessage = ({ data: d }) => postMessage(d.played ? { played: d.played, at: now() } : d);
    audio.postMessage({ fs: hello ? hello.fs : 8000 });
  } else if (m.silent) audio = null;
  else if ("listen" in m) output = m.listen;
  else if (m.ask) audio?.postMessage(m);
  else if (up && ws.bufferedAmount < 65536) ws.send(JSON.stringify(m));
};
