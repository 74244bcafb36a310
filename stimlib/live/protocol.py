"""The messages between page and server over the single WebSocket, ``/ws``.

Text is one JSON object. Messages of the page have ``do``, messages of the server have
``is``; other fields are as in the tables.

=========== ============================ ===============================================
page: do    fields                       meaning
=========== ============================ ===============================================
hello       token, version, page         first message, within 2 s; the token is the
                                         URL's fragment; page: optional, a random name
                                         that a page keeps when it is loaded again
move        finger, u, v, p, on, t       finger 0 .. 9 is at (u, v), 0 to 1 from the
                                         pad's lower left corner, with pressure p (0 to
                                         1); on: 1 touches, 0 not (hovers, or has left);
                                         t: the event's time in ms, which comes back in
                                         its samples
set         name, value                  a parameter, in its unit, within the range that
                                         hello has; 20 ms ramp
source      input, from, finger, low,    source of an input, from: ``u``, ``v``,
            high, freq, value, channel,  ``pressure`` (low at 0, high at 1), ``contact``
            scale                        (0, 1), each of a finger; ``sine`` (between low
                                         and high, freq in Hz), ``value`` (held),
                                         ``given`` (what --motion gave), ``stream``
                                         (number ``channel`` of the rows that another
                                         program sends, times ``scale``, within low and
                                         high). Omitted fields do not change
mark                                     a marker of the name ``page``, at the next
                                         sample
start                                    a new session from sample 0, faded in; ends one
                                         that runs
stop                                     fade out and end the session; a recording is
                                         whole then
record                                   as start, with a log; ``stop`` ends it. State
                                         tells its folder
control                                  take control; a page that has it watches from
                                         then on
seen        at                           answer to each report, with its at; a page that
                                         says nothing for 2 s counts as gone; after a
                                         longer pause, for twice that, at most 5 s
=========== ============================ ===============================================

=========== ============================ ===============================================
server: is  fields                       meaning
=========== ============================ ===============================================
hello       version, title, fs, block,   first message, and again when the scene was
            inputs, params, outputs,     edited; see below. stream: whether there is one
            view, about, stream, marks,  to choose; marks: whether markers are sent
            behind                       somewhere; behind: s from a pointer's time
                                         stamp to its motion, and those of its smoothing
state       role, controlled, phase,     after hello and after every change. role:
            session, log, recorded,      control or watch; controlled: whether any page
            sources, params, why         has control; phase: idle, starting, running or
                                         stopping; session: number of it; log: folder of
                                         the recording, or null; recorded: a sentence on
                                         the last one; sources: {input: source}; params:
                                         {name: value}; why: what ended the last
                                         session, or why an edited scene is not played
report      session, at, seconds, lost,  five times a second while a session runs. at:
            underruns, late, skipped,    next sample; lost: samples that came too late
            clips, energy, faults,       in underruns times; late: s behind now;
            silent, rows, rejected,      skipped: blocks that this page was too slow
            time, busy                   for; clips, energy, faults, silent, rows,
                                         rejected as in a sink's report; time: Unix time
                                         in s; busy: part of a block's time
alive                                    five times a second while no session runs
error       about, text                  the request is rejected, and why; about: its
                                         ``do``
=========== ============================ ===============================================

hello has

- inputs: list of {name, unit, low, high, given}: low and high are a sensible range,
  given whether ``from: given`` exists
- params: list of {name, unit, value, low, high, meaning}, for sliders; meaning: a
  sentence, or ""
- outputs: list of {name, unit, full, vibrates}: full is the value in that unit that is
  1 in the samples and at a device, so the safety stage's limit; vibrates: whether it
  does more than follow a slow motion, while every input sweeps its range in a second
- about: {do, felt, laws, sources, fixed}, see `stimlib.scenes.about.about`
- view: null, or what is drawn of the scene, with lengths in m and ``values``, the names
  of the inputs and outputs that the drawing needs: {kind: "surface", width, height,
  columns, rows, levels (rows * columns numbers 0 to 1, first row at y = 0), inputs: {x,
  y, press (or null)}, avatars: list of {x, y, depth (or null)}, force (or null)};
  {kind: "plate", length}, a plate on a helix of this length, which the only value
  presses; {kind: "pad", length, hidden: list of [begin, end]}, a finger at the only
  value on a pad with ridges

Samples are binary, little-endian: HEAD float64

====== ==================================================================
0      index of the first sample, from the start of the session
1      t of the newest move that these samples have seen, 0 if none
2      ms from its arrival at the server until these samples were made
3      the server's clock in s when they were made (its zero means nothing)
4      number of the session
5      n, samples in this message, at most block
====== ==================================================================

then float32: n of each input (in its unit, as the scene had them), n of each output (of
full scale, -1 to 1, as a device is given them). Missing indices were lost or
skipped. The index is that of the session's log, so drawn samples can be found in a
recording.

The server closes with 4400 (messages not understood), 4401 (no or wrong token), 4409
(two pages are there already), 4410 (a page of the same name came) or 4429 (too many
messages): trying again does not help. In all other cases it does, also with 4408
(silent, or reads nothing): a page reconnects to a server that it has lost.

A page of the same name as the one that had control has it again, if it comes within
2 s: the session goes on meanwhile, with fingers where they were.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BadValue
from ..system import fields

VERSION = 1
HEAD = 6
"""Number of float64 values before the samples."""

MESSAGE = 1024
"""Largest size of a page's message in bytes."""
RATE, BURST = 1200.0, 1200.0
"""Largest number of messages of a page per second, and at once: a server that was late
receives those of a second.
"""
WRONG = 20
"""Number of invalid messages that a page may send."""
PAGES = 2
SILENT, PATIENCE = 2.0, 5.0
"""Seconds without a message after which a page counts as gone: SILENT, or twice the
longest silence from which it came back, at most PATIENCE.
"""
GRACE = 2.0
"""Seconds for which control is kept for a page that is loaded again."""
REPORTS = 0.2
"""Seconds between reports."""

FINGERS = 10
POINTERS = ("u", "v", "pressure", "contact")
SOURCES = (*POINTERS, "sine", "value", "given", "stream")

_UNIT = fields.between(0, 1)
_WIDE = fields.between(-1e9, 1e9)
_FINGER = fields.whole(FINGERS - 1)
FIELDS: dict[str, dict[str, fields.Test]] = {
    "hello": {"token": fields.text, "version": fields.whole(1000)},
    "move": {
        "finger": _FINGER,
        "u": _UNIT,
        "v": _UNIT,
        "p": _UNIT,
        "on": fields.whole(1),
        "t": fields.between(0, 1e14),
    },
    "set": {"name": fields.text, "value": fields.number},
    "source": {"input": fields.text, "from": fields.one_of(*SOURCES)},
    "start": {},
    "stop": {},
    "record": {},
    "mark": {},
    "control": {},
    "seen": {"at": fields.whole(2**53)},
}
OPTIONS: dict[str, dict[str, fields.Test]] = {
    "hello": {"page": fields.text},
    "source": {
        "finger": _FINGER,
        "low": _WIDE,
        "high": _WIDE,
        "freq": fields.between(0.01, 1000),
        "value": _WIDE,
        "channel": fields.whole(999),
        "scale": _WIDE,
    },
}
"""Optional fields of a message."""


def message(
    text: str | bytes, table: Mapping[str, Mapping[str, fields.Test]] = FIELDS
) -> dict[str, Any]:
    """Parse and check a message from a page.

    Its field ``do`` names a row of the first table above.

    Raises
    ------
    BadValue
        The message is not in the table.

    Examples
    --------
    >>> from stimlib.live.protocol import message
    >>> message('{"do": "set", "name": "k", "value": 2000}')
    {'do': 'set', 'name': 'k', 'value': 2000}
    >>> message('{"do": "set", "name": "k", "value": NaN}')
    Traceback (most recent call last):
    stimlib.errors.BadValue: page: NaN is not a finite number
    """
    try:
        found = fields.parse(text if isinstance(text, bytes) else text.encode())
        fields.require(found, {"do": fields.one_of(*table)})
        known = table[found["do"]]
        fields.require(found, known)
        given = {k: test for k, test in OPTIONS.get(found["do"], {}).items() if k in found}
        fields.require(found, given)
        if surplus := found.keys() - {"do"} - known.keys() - given.keys():
            raise ValueError(f"{found['do']} has no {', '.join(sorted(surplus))[:80]}")
    except ValueError as e:
        raise BadValue(f"page: {e}") from None
    return found


def samples(head: tuple[float, ...], x: NDArray[np.float64], y: NDArray[np.float32]) -> bytes:
    """Return a block of samples as a binary message.

    Parameters
    ----------
    head : tuple of HEAD float
    x : ndarray, shape (n_inputs, n)
    y : ndarray, shape (n_outputs, n)

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.live.protocol import samples
    >>> len(
    ...     samples(
    ...         (0, 0, 0, 0, 1, 32), np.zeros((1, 32)), np.zeros((2, 32), np.float32)
    ...     )
    ... ) == 6 * 8 + 3 * 32 * 4
    True
    """
    return np.array(head, "<f8").tobytes() + x.astype("<f4").tobytes() + y.astype("<f4").tobytes()
