// What the page talks to: the worker that owns the WebSocket, and its sound. A shared page has web/connect.js in its place.

import { Sound } from "./sound.js";

export function connected() {
  const link = new Worker("link.js", { type: "module" });
  return { link, sound: new Sound(link) };
}
