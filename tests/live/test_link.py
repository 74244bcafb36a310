"""The worker that owns the page's connection, in node: what counts as silence, and what
is not sent when the connection is slow.
"""

import shutil

import pytest
from live.node import LIVE, told

WORKER = """
let t = 0, tick, ws;
const said = [], silent = () => said.filter(m => m.state === "silent").length;
Object.defineProperty(globalThis, "performance", { value: { timeOrigin: 0, now: () => t } });
Object.assign(globalThis, {
  onmessage: null, setInterval: f => { tick = f; }, postMessage: m => said.push(m),
  WebSocket: class {
    constructor() { ws = this; this.sent = []; this.bufferedAmount = 0; }
    send(m) { this.sent.push(JSON.parse(m).do); }
    close() {}
  },
});
await import("./link.js");
const ticks = n => { for (; n; n--) { t += 250; tick(); } };
const told = m => ws.onmessage({ data: JSON.stringify(m) });
onmessage({ data: { open: "ws://page", token: "T", page: "p" } });
ws.onopen();
told({ is: "hello", fs: 8000, inputs: [], outputs: [] });
told({ is: "report", at: 0 });
"""


@pytest.mark.parametrize(
    ("script", "wanted"),
    [
        # what the worker itself was late is no silence
        (
            """ticks(4); // 1 s
            told({ is: "report", at: 8 });
            t += 3000; // it stands still
            tick();
            const late = silent();
            ticks(8);
            console.log(JSON.stringify([late, silent() > 0]));""",
            [0, True],
        ),
        # nor is it a reason for another connection
        (
            """ticks(1);
            onmessage({ data: { open: "ws://page", token: "T", page: "p" } });
            const first = ws;
            t += 9000; // it stands still before the server answers
            tick();
            const late = ws !== first;
            ticks(20); // 5 s
            console.log(JSON.stringify([late, ws !== first]));""",
            [False, True],
        ),
        # only moves are left out when the connection is slow
        (
            """ws.bufferedAmount = 1e5;
            for (const m of ["move", "stop"]) onmessage({ data: { do: m } });
            console.log(JSON.stringify(ws.sent));""",
            ["hello", "seen", "stop"],
        ),
        # samples go to the sound and their vibration to the page, of a ramp in three
        # messages; at first a vibration begins with 0, after a gap it is not known, and
        # a move is marked in the first message that contains it
        (
            """const audio = [];
            told({ is: "hello", fs: 8000, inputs: [], outputs: [{}] });
            onmessage({ data: { audio: { postMessage: m => audio.push(m) } } });
            audio.pop();
            const firsts = [[0, 7], [8, 7], [20, 9]].map(([at, move]) => {
              const data = new ArrayBuffer(6 * 8 + 4 * 8);
              new Float64Array(data, 0, 6).set([at, move, 0, at / 1000, 2, 8]);
              new Float32Array(data, 48).set(Array.from({ length: 8 }, (_, k) => at + k));
              ws.onmessage({ data });
              return new Float32Array(said.pop().samples, 48 + 32)[0];
            });
            const sent = audio.map(m => [m.at, m.session, m.made, m.t, m.y.length]);
            console.log(JSON.stringify([firsts.map(v => v === v ? v !== 0 : null), sent]));""",
            [
                [False, True, None],
                [[0, 2, 0, 7, 8], [8, 2, 0.008, 0, 8], [20, 2, 0.02, 9, 8]],
            ],
        ),
    ],
    ids=["late", "connection", "slow", "samples"],
)
def test_the_worker_knows_a_slow_connection_from_its_own_delay(tmp_path, script, wanted):
    for name in ("link.js", "vibration.js"):
        shutil.copy(LIVE / "page" / name, tmp_path)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "test.js").write_text(f"{WORKER}\n{script}")
    assert told(tmp_path / "test.js") == wanted
