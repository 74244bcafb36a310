// The questions of a session: the state that the server tells is shown, one answer to each is said. asking.py has the messages.

const GUARD = 250; // ms in which a new question takes nothing: the second half of a double click was for the one before
const $ = id => document.getElementById(id);
const link = new Worker("link.js");
const WORDS = { rest: "Please rest", feel: "Feel", wait: "One moment", end: "" };
let state = null, open = false, sent = false, begun = 0, frame = 0, late = 0; // begun: when the state began here, in ms

const element = (parent, tag, more = {}) => Object.assign(parent.appendChild(document.createElement(tag)), more);
const words = (text, kind = "") => { $("state").textContent = text; $("state").className = kind; };

function become(now) {
  const fresh = now.number !== state?.number;
  state = now;
  sent = false;
  clearTimeout(late);
  begun = performance.now() - 1000 * now.since;
  $("trial").textContent = now.trial === now.text ? "" : now.trial;
  $("told").replaceChildren();
  for (const textContent of now.told) element($("told"), "p", { textContent });
  $("text").textContent = now.text ?? WORDS[now.phase];
  buttons(now.keys ?? []);
  $("line").hidden = !now.line;
  $("words").replaceChildren();
  for (const word of now.words ?? [])
    element($("words"), "button", { type: "button", textContent: word, onclick: () => { $("typed").value = `${$("typed").value} ${word}`.trim(); } });
  enable(); // or it takes no focus
  if (fresh) $("typed").value = "";
  if (fresh && now.line) $("typed").focus();
  $("clock").hidden = !["rest", "feel"].includes(now.phase);
  $("track").hidden = !now.cursor;
  words("Connected", "good");
  tick();
}

function buttons(keys) {
  $("keys").replaceChildren();
  for (const [key, says] of keys) {
    const button = element($("keys"), "button", { type: "button", onclick: () => answer(key) });
    if (key) element(button, "kbd", { textContent: key });
    button.append(says);
  }
}

function answer(text) {
  if (!open || sent || state?.phase !== "ask" || performance.now() - begun < GUARD) return;
  sent = true;
  link.postMessage({ do: "answer", number: state.number, text });
  late = setTimeout(() => words("Sent. Please wait."), 1500);
  enable();
}

const enable = () => { for (const b of document.querySelectorAll("button, input")) b.disabled = !open || sent; };

/** What moves: seconds that are left of a rest, which interval it is, the reference. */
function tick() {
  const t = (performance.now() - begun) / 1000;
  if (state.phase === "rest") {
    const left = Math.max(0, Math.ceil(state.seconds - t));
    $("clock").textContent = `${Math.floor(left / 60)}:${String(left % 60).padStart(2, "0")}`;
  } else if (state.phase === "feel") {
    const all = state.intervals, k = all.findIndex(([a, b]) => a <= t && t < b);
    $("clock").textContent = k < 0 ? "" : all.length > 1 ? `${k + 1} of ${all.length}` : "now";
    const y = k < 0 || !state.cursor ? 0 : Math.sin(2 * Math.PI * state.cursor * (t - all[k][0]));
    $("point").style.transform = `translateY(${-0.5 * y * ($("track").clientHeight - $("point").clientHeight)}px)`;
  } else return;
  cancelAnimationFrame(frame);
  frame = requestAnimationFrame(tick);
}

link.onmessage = ({ data: m }) => {
  if (m.text?.is === "state") become(m.text);
  else if (m.text?.is === "error") { sent = false; words(m.text.text, "bad"); }
  else if (m.state === "open") open = true;
  else if (m.state) {
    open = false;
    if (m.state === "lost") words("Connection lost, trying again. Please wait.", "bad");
    else words(state?.phase === "end" ? "The session is over: you may close this page." : `Closed: ${m.why}`, state?.phase === "end" ? "" : "bad");
  } else return;
  enable();
};
link.postMessage({ open: `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`, token: location.hash.slice(1) });
addEventListener("hashchange", () => location.reload()); // the address of a session that was resumed at the same port

$("line").onsubmit = e => { e.preventDefault(); if ($("typed").value.trim()) answer($("typed").value); };
addEventListener("keydown", e => {
  if (e.ctrlKey || e.metaKey || e.altKey || e.isComposing || e.target.matches?.("input")) return;
  if (e.target.matches?.("button") && ["Enter", " "].includes(e.key)) { if (e.repeat) e.preventDefault(); return; } // it clicks
  const keys = (state?.keys ?? []).map(([key]) => key), any = keys.includes("") && (e.key.length === 1 || e.key === "Enter");
  const key = [e.key, e.key.toLowerCase()].find(k => keys.includes(k)) ?? (any ? "" : null);
  if (key === null) return;
  e.preventDefault();
  if (!e.repeat) answer(key);
});
