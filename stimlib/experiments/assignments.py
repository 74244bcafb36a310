"""Assignment of participants to orders or conditions, in a file for all experimenters.

The file is JSON: ``orders`` and ``seed``, and in ``participants`` the order of each, in
the order in which they were assigned.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..errors import BadValue, SinkError, UnknownName, public, said_as
from ..system import fields, safe_files
from .designs import shuffled
from .reader import check_code

WAIT = 10.0  # seconds for another process that writes the file
TESTS = {
    "seed": fields.whole(2**64 - 1),
    "orders": fields.list_of(fields.Test("any value", lambda v: True)),
    "participants": fields.table,
}


@public
def assign(
    path: str | os.PathLike[str], participant: str, orders: Sequence[Any], seed: int = 0
) -> Any:
    """Assign a participant to an order, and record it in a file.

    Participants are assigned in blocks: each n of them, in the order in which they
    come, get the n orders in a random order of the block's own.

    Parameters
    ----------
    path : path
        The file, which is made for the first participant. Of several processes that
        assign at the same time one writes, and the others wait.
    participant : str
        A code such as "P07".
    orders : sequence of JSON data
        Names of conditions, or lists of them, such as ``williams(4).T``; one that is
        there twice is assigned twice as often.
    seed : int
        Of the blocks' orders. The same seed, orders and sequence of participants make
        the same file.

    Returns
    -------
    JSON data
        One of the orders.

    Raises
    ------
    BadValue
        A participant who has an order already, or is no code; no orders, or such that
        are no JSON data; a path that is a folder; a file that was begun with other
        orders or another seed.
    SinkError
        The file cannot be read or written, is a link, was edited, or another process
        writes it for longer than 10 s.

    Notes
    -----
    Permuted blocks: Matts & Lachin 1988, Controlled Clinical Trials 9, 327-344. On file
    systems without locks, such as some network shares, processes do not wait for each
    other.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from stimlib.experiments import assign, assigned, williams
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "orders.json"
    >>> for code in ("P01", "P02", "P03", "P04"):
    ...     print(code, assign(path, code, williams(4).T, seed=1))
    P01 [0, 1, 3, 2]
    P02 [2, 3, 1, 0]
    P03 [1, 2, 0, 3]
    P04 [3, 0, 2, 1]
    >>> assigned(path, "P02")
    [2, 3, 1, 0]
    >>> assign(path, "P02", williams(4).T, seed=1)  # by another experimenter
    Traceback (most recent call last):
    stimlib.errors.BadValue: assign: ... participant P02 has the order [2, 3, 1, 0] ...
    """
    check_code(participant)
    seed = int(seed)
    try:
        known = json.loads(json.dumps(list(orders), default=lambda v: v.tolist(), allow_nan=False))
    except RecursionError:
        raise BadValue(
            "orders are nested too deeply; give names, numbers or lists of them"
        ) from None
    except (AttributeError, TypeError, ValueError) as e:
        raise BadValue(
            f"orders = {orders!r:.80} must be names, numbers or lists of them, and finite: {e}"
        ) from e
    if not known:
        raise BadValue("orders is empty; give at least one")
    path = Path(path)
    if not path.name:
        raise BadValue(f"path = {str(path)!r} is a folder; give the name of a file")
    if path.is_symlink():  # a write would replace it, and leave the file behind it as it was
        raise SinkError(f"{path} is a link; give the path of the file that it leads to")
    safe_files.make_folder(path.parent)
    lock, until = path.with_name(f"{path.name}.lock"), time.monotonic() + WAIT
    with ExitStack() as stack:
        while safe_files.taken(stack, lock) is None:
            stack.close()
            if time.monotonic() > until:
                raise SinkError(f"{path} is in use by another process; try again when it has ended")
            time.sleep(0.02)
        new = {"seed": seed, "orders": known, "participants": {}}
        table = _read(path) if os.path.lexists(path) else new
        if (table["seed"], table["orders"]) != (seed, known):
            raise BadValue(
                f"{path} was begun with seed = {table['seed']} and orders ="
                f" {table['orders']!r:.80}; give these, or the name of a new file"
            )
        people = table["participants"]
        check_code(participant, people)
        if participant in people:
            raise BadValue(
                f"{path}: participant {participant} has the order {people[participant]!r:.80}"
                " already; read it with assigned(..), or give the code of a new participant"
            )
        people[participant] = _order(table, len(people))
        safe_files.publish(path, json.dumps(table, indent=1) + "\n")
    return people[participant]


@public
def assigned(path: str | os.PathLike[str], participant: str) -> Any:
    """Return the order that `assign` recorded for a participant.

    Parameters
    ----------
    path : path
        The file.
    participant : str

    Raises
    ------
    SinkError
        The file cannot be read, or was edited.
    UnknownName
        The participant has no order yet.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from stimlib.experiments import assign, assigned
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "groups.json"
    >>> assign(path, "P01", ["vibration", "silent"], seed=1)
    'vibration'
    >>> assigned(path, "P01")
    'vibration'
    """
    people = _read(Path(path))["participants"]
    if participant not in people:
        raise UnknownName(
            f"{path}: participant {participant!r} has no order yet; call assign first; there are"
            f" {', '.join(people)}"
        )
    return people[participant]


@lru_cache(maxsize=64)
def _block(seed: int, number: int, n: int) -> list[str]:
    return shuffled(seed, f"assignment {number}", [str(i) for i in range(n)])


def _order(table: dict[str, Any], k: int) -> Any:
    """Return the order of the participant who is assigned after k others."""
    n = len(table["orders"])
    return table["orders"][int(_block(table["seed"], k // n, n)[k % n])]


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a file, or raise if it is no assignment or was edited."""
    data = safe_files.read(path, "sidecar_bytes")
    with said_as(SinkError, f"{path} is no assignment of participants", ValueError):
        table = fields.parse(data)
        fields.require(table, TESTS)
    for k, (code, order) in enumerate(table["participants"].items()):
        if not table["orders"] or order != _order(table, k):
            raise SinkError(
                f"{path} was edited: participant {code!r} has another order than its seed gives;"
                " take the copy from before"
            )
    return table
