"""Rows of numbers from outside: each dialect is read right, or rejected by name."""

import math
import os
import random
import re
import socket
import struct
import time
import tty
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import ran
from devices.servers import until
from fuzz.mutations import mutated
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder
from refusals import refused

from stimlib import SinkError
from stimlib.devices import Stream, lsl_motion, lsl_streams, receiver, serial_motion, udp_motion
from stimlib.devices.rows import REMEDIES, row_of
from stimlib.devices.sources import Receiver

COMMA, POINT, SEP, DEC = "comma between digits", "decimal point", "separator", "decimal"
NONE = "no numbers"
DIALECTS = [  # what is sent, the column of x, and its position or why it is rejected
    (b"0.0127", 0, 0.0127),
    (b"0.0127\r", 0, 0.0127),
    (b"0.0127\r\n\n  \n", 0, 0.0127),
    (b"", 0, None),
    (b" \t", 0, None),
    (b"7 0.0127", 1, 0.0127),
    (b"7\t0.0127", 1, 0.0127),
    (b"7;0.0127", 1, 0.0127),
    (b"7 ; 0.0127;", 1, 0.0127),
    (b"7, 0.0127", 1, 0.0127),
    (b"7.0,0.0127", 1, 0.0127),
    (b"7E0,127e-4", 1, 0.0127),
    (b"7,-0.0127", 1, -0.0127),
    (b"7.0, 0.0127,", 1, 0.0127),
    (b"[7.0, 0.0127]", 1, 0.0127),
    (b"( 7.0 0.0127 )", 1, 0.0127),
    (b"[7.0, 0.0127", 1, NONE),
    (b"7,0.0127", 1, COMMA),
    (b"512,300", 1, COMMA),
    (b"[7,0127]", 0, COMMA),
    (b"0,0127", 0, COMMA),
    (b"12,7 3,2", 1, COMMA),
    (b"12,7, 3,2", 1, COMMA),
    (b"12,7;3,2", 1, COMMA),
    (b"1,5e-05 1e-05", 0, COMMA),
    (b"1.234,56", 0, COMMA),
    (b"1,234.56", 0, COMMA),
    (b"x:0,0127", "x", COMMA),
    (b"0,010000,0,020000", 1, COMMA),
    ((b"512,300", SEP), 1, 300.0),
    ((b"512 , 300", SEP), 1, 300.0),
    ((b"512,,300", SEP), 1, "empty field"),
    ((b",300", SEP), 0, "empty field"),
    ((b"x:0,0127", SEP), "x", NONE),
    ((b"12,7 3,2", SEP), 3, 2.0),
    ((b"7,,5", DEC), 1, "empty field"),
    (b"7,,5", 1, "empty field"),
    ((b"7, 5", DEC), 1, 5.0),
    ((b"0,0127", DEC), 0, 0.0127),
    ((b"12,7 3,2", DEC), 1, 3.2),
    ((b"12,7;-3,2e-1", DEC), 1, -0.32),
    ((b"12,7, 3,2", DEC), 1, 3.2),
    ((b"x:12,7,y:3,2", DEC), "y", 3.2),
    ((b"12,7,3,2", DEC), 0, NONE),
    ((b"1.234,56", DEC), 0, POINT),
    ((b"0.0127", DEC), 0, POINT),
    (b"x:0.0127", "x", 0.0127),
    (b"x=0.0127 y=2", "x", 0.0127),
    (b"y: 2, x: 0.0127", "x", 0.0127),
    (b"id:hand\tx:0.0127", "x", 0.0127),
    (b"hand/x-1.y:0.0127", "hand/x-1.y", 0.0127),
    (b"y:2", "x", "no such label"),
    (b"x:0.0127", 0, "no such label"),
    (b"x:1 x:2", "x", "label twice"),
    (b"x:hand", "x", NONE),
    (b"x:", "x", "empty field"),
    (b"x:0.0127 2", "x", NONE),
    (b"x 0.0127", "x", NONE),
    (b"0.0127", "x", "no labels"),
    (b'{"x": 0.0127}', "x", 0.0127),
    (b'{"p":[1,2],"id":"hand","on":true,"x":1.27E-2}', "x", 0.0127),
    ((b'{"x": 0.5, "y": 0.0127}', DEC), "y", 0.0127),
    (b'{"x": 0,0127}', "x", "no JSON"),
    (b"{'x': 0.0127}", "x", "no JSON"),
    (b'{"x": 1, "x": 2}', "x", "label twice"),
    (b'{"x": "0.0127"}', "x", NONE),
    (b'{"x": true}', "x", NONE),
    (b'{"x": null}', "x", NONE),
    (b'{"x": NaN}', "x", "not finite"),
    (b'{"x": 1' + b"0" * 5000 + b"}", "x", "not finite"),
    (b'{"x": 0.0127}', 0, "no such label"),
    (b'{"x": {"y": 0.0127}}', "y", "no such label"),
    (b"{}", "x", "no JSON"),
    (b" " * 60_000 + b":", 0, NONE),
    (b'{"x": ' + b"[" * 50_000, "x", "no JSON"),
    (b"1_000", 0, NONE),
    (b"infinity", 0, NONE),
    (b"-inf", 0, NONE),
    (b"0x1F", 0, NONE),
    (b"true", 0, NONE),
    ("\u0661\u0662".encode(), 0, NONE),  # Arabic digits
    ("\u22120.0127".encode(), 0, NONE),  # a typographic minus
    (b"nan", 0, "not finite"),
    (b"NaN 0.0127", 1, 0.0127),
    (b"1e999", 0, "not finite"),
    (b"+.127e-1", 0, 0.0127),
    (b"5.", 0, 5.0),
    (b".", 0, NONE),
    (b"12.7mm", 0, NONE),
    (b"7 {", 0, NONE),
    (b"time,x", 0, NONE),
    (b"$0.0127*3F", 0, NONE),
    (b"7 0.0127", 2, "too short"),
    (b"\xef\xbb\xbf0.0127", 0, 0.0127),
    ("0.0127".encode("utf-16"), 0, NONE),
    (b"\xff0.0127", 0, NONE),
    (b"0.0\x00127", 0, NONE),
    (b"1\xc2\xa0234", 0, NONE),  # a blank that does not break, for thousands
    (b"7" + b" " * 3000 + b"0.0127", 1, 0.0127),
]


class Taken(Receiver):
    """A receiver whose positions stay in a list; no device plays them."""

    def __init__(self, receive, column=0, **options):
        self.x = []
        pump = SimpleNamespace(proc=SimpleNamespace(inputs=("x",)), put_motion=self.put)
        super().__init__(pump, Stream(receive=receive, columns={"x": column}, **options), None)
        self.receive = receive

    def put(self, x):
        self.x.append(x[:, :8192])  # as the ring at 8 kHz
        return x[:, :8192].shape[1]

    def __call__(self, timeout=1.0):
        """Return the positions that a call of ``receive`` brings."""
        self.x.clear()
        self._take(*self.receive(timeout))
        return np.concatenate([np.zeros((1, 0)), *self.x], axis=1)[0].tolist()


@pytest.fixture
def here():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        yield s


@pytest.fixture
def line(tmp_path):
    """A serial port, and a function that plugs in a device and returns its end."""
    ends = []

    def plug():
        ends.extend(os.openpty())
        tty.setraw(ends[-1])
        (tmp_path / "port").unlink(missing_ok=True)
        (tmp_path / "port").symlink_to(os.ttyname(ends[-1]))
        return ends[-2]

    yield str(tmp_path / "port"), plug
    for end in ends:
        with suppress(OSError):
            os.close(end)


@pytest.mark.parametrize(("sent", "column", "expected"), DIALECTS)
def test_a_row_is_read_right_or_rejected_by_name(sent, column, expected, here):
    data, comma = sent if isinstance(sent, tuple) else (sent, None)
    with udp_motion(0, comma=comma) as receive:
        taken = Taken(receive, column)
        here.sendto(data, ("127.0.0.1", receive.port))
        x = taken()
    number = isinstance(expected, float)
    assert x == [expected] * number
    assert taken.rejected == ({expected: 1} if expected and not number else {})
    assert all(0 < len(text) <= 40 for text in taken.examples.values())


def test_numbers_in_any_notation_are_right_or_rejected():
    """Four formats of numbers, with decimal points or commas, and seven separators."""
    rng, taken, wrong = random.Random(1), 0, []
    for _ in range(2000):
        numbers = [rng.choice([0, 1, -5, 1e-5, 12.7, rng.uniform(-99, 99)]) for _ in "xyz"]
        form, decimal = rng.choice(["g", "f", "e", ".0f"]), rng.choice(".,")
        texts = [f"{v:{form}}" for v in numbers[: rng.randint(1, 3)]]
        separator = rng.choice([" ", "\t", ",", ";", ", ", "; ", " , "])
        sent = separator.join(text.replace(".", decimal) for text in texts)
        declared = [] if decimal + separator == ",," else [DEC if decimal == "," else SEP]
        for comma in (None, *declared):
            row, _, why = row_of(sent.encode(), comma=comma)
            taken += not why
            if not why and row != [float(text) for text in texts]:
                wrong.append((sent, comma, row))
    assert not wrong and taken > 3000


@pytest.mark.parametrize("n", [1, 8192, 20000])
def test_the_newest_row_of_a_burst_is_taken(n):
    rows = [[float(k)] for k in range(n)]
    assert Taken(lambda timeout: (rows, [math.nan] * n))()[-1] == n - 1


def test_times_are_numbers_and_older_rows_are_out_of_order(here):
    """A sender may set its clock back by more than 1 s, and sends irregular chunks."""
    rows = [(5.0, 0.1), (5.2, 0.2), (5.1, 0.3), (5.2, 0.2), (5.2, 0.4), (5.1, 0.5), (4.3, 0.6)]
    rows += [(4.1, 0.7), (4.2, 0.8), (5.1, 1.1), (4.25, 0.9)]
    lines = [f"{t} {x}" for t, x in rows] + ["nan 0.5", "5.5", "t:7 x:0.5"]
    with udp_motion(0, timed=True) as receive:
        taken, to = Taken(receive, limits={"x": (0.0, 1.0)}), ("127.0.0.1", receive.port)
        here.sendto("\n".join(lines).encode(), to)
        assert taken() == [0.1, 0.2, 0.4, 0.7, 0.8, 0.9]
        once = "repeated", "outside its limits", "no time", "too short", "no such label"
        assert taken.rejected == {"out of order": 3} | dict.fromkeys(once, 1)
        assert taken.examples["out of order"] == "[0.3]"
        here.sendto(b"0.5 0.25\0\0", to)  # a text of C
        assert taken() == [0.25]
    with udp_motion(0) as receive:  # two that wait, without ends of lines
        for text in (b"0.1", b"0.2"):
            here.sendto(text, ("127.0.0.1", receive.port))
        assert Taken(receive)() == [0.1, 0.2]


def test_a_serial_port_that_is_closed_is_not_opened_again(line):
    port, plug = line
    plug()
    receive, opened = serial_motion(port), len(os.listdir("/proc/self/fd"))
    receive.close()
    assert receive(0.01) == ([], [], []) and len(os.listdir("/proc/self/fd")) < opened


@pytest.mark.parametrize(
    ("options", "sent", "newest"),
    [({"timed": True}, b"5.0 0.1", 5.0), ({"comma": DEC}, b"0,1", -math.inf)],
)
def test_options_of_a_serial_line(line, options, sent, newest):
    port, plug = line
    device, x = plug(), []
    with serial_motion(port, **options) as receive:
        os.write(device, b"0\n" + sent + b"\n")
        taken, end = Taken(receive), time.monotonic() + 60.0
        while not x:  # a terminal may give a line in pieces
            assert time.monotonic() < end
            x += taken()
        assert (x, taken.rejected) == ([0.1], {"partial line": 1})
        assert taken.examples == {"partial line": "'\u20260'"}
        assert newest < 0 or taken._newest[0] == newest


def test_a_function_of_ones_own_rejects_rows_too():
    """A whole number may be too large for a float, and what it shows too long."""
    rows = [[10**400], b"0.7", "0.7", [0.5]], [math.nan] * 4, [("odd", "x" * 99)]
    taken = Taken(lambda timeout: rows)
    assert taken() == [0.5]
    assert taken.rejected == {"odd": 1, "not finite": 1, "no numbers": 2}
    assert taken.examples["odd"] == "x" * 40


def test_a_part_of_a_line_is_no_row(line):
    """The port opens within a line, is unplugged, comes back, and has a pause."""
    port, plug = line
    device = plug()
    taken = Taken(receiver(f"serial:{port}"))

    def sends(data, x, partial=None):
        os.write(device, data)
        got = taken()
        until(lambda: len(got) >= len(x) or got.extend(taken()))  # a terminal may give a part
        assert got == x
        assert partial is None or taken.rejected == {"partial line": partial}

    sends(b"23.0\n0.01\r\n0.0", [0.01])
    sends(b"2", [])
    sends(b"\r0.03\r", [0.02, 0.03])
    sends(b"0.0", [])
    os.close(device)
    device = plug()
    for _ in range(3):
        assert taken(0.01) == []
    sends(b"45\n0.05\n", [0.05], 2)
    for _ in range(20):  # a line without an end
        sends(b"0" * 3900, [])
    sends(b"9\n0.06\n0.0", [0.06], 3)
    os.write(device, b"7\n0.08\n0.0")
    time.sleep(1.1)  # nobody calls: the terminal may have overflowed since
    assert taken() == []
    sends(b"9\n0.1\n", [0.1], 4)
    taken.receive.close()


# Open Sound Control -------------------------------------------------------------------
def message(*values, address="/hand"):
    built = OscMessageBuilder(address=address)
    for value in values:
        built.add_arg(value, *(["d"] if isinstance(value, float) else []))
    return built.build()


def bundle(*parts):
    built = OscBundleBuilder(IMMEDIATELY)
    for part in parts:
        built.add_content(part)
    return built.build()


HAND = message(1, 0.0127).dgram
NESTED = HAND
for _ in range(3000):
    NESTED = b"#bundle\0" + bytes(8) + struct.pack(">I", len(NESTED)) + NESTED
DATAGRAMS = [
    (HAND, [0.0127], {}),
    (message("hand", 0.0127).dgram, [0.0127], {}),
    *((message(b"12345678"[:n], 0.0127).dgram, [0.0127], {}) for n in (1, 4, 5)),
    (message(True, 0.0127).dgram, [0.0127], {}),
    (b"/hand\0\0\0,Sf\0abcd\0\0\0\0" + struct.pack(">f", 0.5), [0.5], {}),
    (message([7.0, 0.5]).dgram, [0.5], {}),
    *(
        (
            b"/hand\0\0\0,%cf\0" % tag + bytes(4 * (tag in b"crm")) + struct.pack(">f", 0.5),
            [0.5],
            {},
        )
        for tag in b"crmTFNI"
    ),
    (b"/hand\0\0\0,th\0" + bytes(15) + b"\5", [5.0], {}),
    (bundle(message(1, 0.01), bundle(message(1, 0.02)), message(1, 0.03)).dgram, 3, {}),
    (bundle(message(1, 0.01), message(1, address="/a")).dgram, [0.01], {"another address": 1}),
    (bundle().dgram, [], {}),
    (message(1, 0.01, address="/hand/2").dgram, [], {"another address": 1}),
    (message(1).dgram, [], {"too short": 1}),
    (message(1, "0.0127").dgram, [], {"no numbers": 1}),
    (message(1, True).dgram, [], {"no numbers": 1}),
    (message(1, math.nan).dgram, [], {"not finite": 1}),
    (HAND[:-4], [], {"no OSC": 1}),
    (b"/hand\0\0\0,ff\0" + struct.pack(">f", 0.5), [], {"no OSC": 1}),  # the second is missing
    (b"/hand\0\0\0,Qf\0" + struct.pack(">f", 0.5), [], {"no OSC": 1}),  # of unknown size
    (b"/hand\0\0\0,f,f" + bytes(9), [], {"no OSC": 1}),
    (b"/hand\0\0\0,f\xff\0" + bytes(8), [], {"no OSC": 1}),
    (b"/hand\0\0\0,bf\0\xff\xff\xff\xf0" + bytes(8), [], {"no OSC": 1}),
    (b"/hand\0\0\0", [], {"no OSC": 1}),
    (b"#bundle\0" + bytes(8) + b"\xff\xff\xff\xfc", [], {"no OSC": 1}),
    (b"#bundle\0", [], {"no OSC": 1}),
    (bundle(message(1, 0.01)).dgram[:-3], [], {"no OSC": 1}),
    (NESTED, [], {"no OSC": 1}),
    (b"0.5 0.0127\n", [], {"no OSC": 1}),
    (b"", [], {"no OSC": 1}),
]


@pytest.fixture
def osc():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    with receiver(f"osc:{port}/hand") as receive:
        yield receive, ("127.0.0.1", port)


@pytest.fixture
def udp():
    with receiver("udp:0") as receive:
        yield receive, ("127.0.0.1", receive.port)


@pytest.mark.parametrize(("data", "x", "rejected"), DATAGRAMS)
def test_an_osc_datagram_is_read_right_or_rejected_by_name(data, x, rejected, osc, here):
    receive, to = osc
    taken = Taken(receive, 1)
    here.sendto(data, to)
    got = taken()
    assert (got if isinstance(x, list) else len(got)) == x and taken.rejected == rejected
    if "another address" in rejected:
        assert taken.examples["another address"] in ("'/hand/2'", "'/a'")


def test_lsl_channels_have_indexes_and_labels():
    """A chunk without a rate has one time; lost numbers are nan; text is counted."""
    pylsl = pytest.importorskip("pylsl")
    name = f"stimlib rows {os.getpid()}"
    info = pylsl.StreamInfo(name, "MoCap", 3, 0.0, "double64", name)
    info.set_channel_labels(["x", "z", "y"])
    outlet = pylsl.StreamOutlet(info)
    words = pylsl.StreamOutlet(pylsl.StreamInfo(f"{name} text", "T", 1, 500.0, "string", name))
    there = [(s["name"], s["type"], s["channels"], s["fs"]) for s in lsl_streams()]
    assert {(name, "MoCap", 3, 0.0), (f"{name} text", "T", 1, 500.0)} <= {*there}
    said = ran(["devices", "--streams"]).stdout
    assert f"{name} (MoCap) of " in said and "3 channels" in said and "500 Hz" in said
    refused(SinkError, "no stream 'nobody' appeared", lsl_motion, "nobody", wait=0.1)
    chunk = [[0.0, math.nan, 0.1], [0.0, 0.0, 0.2], [0.0, 0.0, 0.2], [0.0, 0.0, math.nan]]
    with lsl_motion(name) as receive, lsl_motion(f"{name} text") as receive_text:
        assert receive(0.0) == ([], [], [])
        for column in ("y", 2):  # by name and by index
            taken, x = Taken(receive, column), []
            outlet.push_chunk(chunk)
            while taken.rows + sum(taken.rejected.values()) < 4:
                x += taken(20.0)
            assert (x, taken.rejected) == ([0.1, 0.2], {"repeated": 1, "not finite": 1})
        words.push_sample(["0.0127"])
        text = Taken(receive_text)
        assert text(20.0) == [] and text.rejected == {"no numbers": 1}
        assert text.examples == {"no numbers": "['0.0127']"}


def test_the_page_has_each_reason():
    page = (Path(__file__).parents[2] / "docs/howto/rows.rst").read_text(encoding="utf-8")
    seen = {e for *_, e in DIALECTS if isinstance(e, str)} | {w for *_, r in DATAGRAMS for w in r}
    timed = {"no time", "outside its limits", "out of order", "repeated", "partial line"}
    assert set(REMEDIES) == seen | timed
    assert set(re.findall(r"\* - ``([a-z A-Z]+)``\n", page)) == set(REMEDIES)


@pytest.mark.parametrize("n", [1000, pytest.param(49_000, marks=pytest.mark.stress)])
@pytest.mark.parametrize("over", ["osc", "udp"])
def test_no_datagram_ends_a_session_or_prints(over, n, request, here, capfd, caplog):
    rng = random.Random(n)
    texts = [sent[0] if isinstance(sent, tuple) else sent for sent, *_ in DIALECTS]
    seeds = [data[:400] for data, *_ in DATAGRAMS] if over == "osc" else texts
    receive, to = request.getfixturevalue(over)
    taken = Taken(receive, 1)
    for k in range(n):
        here.sendto(mutated(rng.choice(seeds), over, rng)[:2000], to)
        if k % 50 == 49:
            taken()
    while any(found := receive(0.05)):
        taken._take(*found)
    assert taken.rows > n / 100 and sum(taken.rejected.values()) + taken.rows > 0.8 * n
    assert len(taken.rejected) > 3 and capfd.readouterr() == ("", "") and not caplog.records
