"""Orders of conditions: Williams squares, randomised blocks, and the file that assigns
participants.
"""

import itertools
import json
import os
import threading
from collections import Counter
from contextlib import ExitStack

import numpy as np
import pytest
from refusals import refused

from stimlib.errors import BadValue, SinkError, UnknownName
from stimlib.experiments import (
    ConstantStimuli,
    Rate,
    Stimulus,
    assign,
    assigned,
    assignments,
    williams,
)
from stimlib.system import safe_files


# Williams squares ---------------------------------------------------------------------
@pytest.mark.parametrize("n", [*range(2, 12), 40, 101, 200])
def test_a_williams_square_is_balanced_for_carry_over(n):
    orders = williams(n).T
    times = 1 + n % 2  # squares
    assert orders.shape == (times * n, n)
    assert (np.sort(orders, axis=1) == np.arange(n)).all()  # each once in an order
    for place in orders.T:
        assert (np.bincount(place, minlength=n) == times).all()
    follows = np.zeros((n, n), int)
    np.add.at(follows, (orders[:, :-1], orders[:, 1:]), 1)
    assert (follows == times * (1 - np.eye(n, dtype=int))).all()


# Randomised blocks --------------------------------------------------------------------
def orders_of(n, shuffle, seeds, repeats=4):
    items = tuple((Rate(str(i), ("q",), Stimulus("a")), None) for i in range(n))
    design = ConstantStimuli(items, repeats, shuffle)
    return np.array([design.init(seed)["order"] for seed in seeds])


@pytest.mark.parametrize("n", [2, 3])
def test_blocks_have_each_condition_once_and_no_repeat_across_the_border(n):
    """Every order of a block is as likely, also where it is drawn anew."""
    found = orders_of(n, "apart", range(180))
    blocks = found.reshape(180, 4, n)
    assert (np.sort(blocks) == np.arange(n)).all()
    assert (found[:, 1:] != found[:, :-1]).all()
    plain = orders_of(n, "each", range(180))
    kept = (plain[:, 1:] != plain[:, :-1]).all(axis=1)  # where there is nothing to redraw
    assert (found[kept] == plain[kept]).all() and 0 < kept.sum() < 180
    if n == 3:
        counts = Counter(map(tuple, blocks[:, 1:].reshape(-1, n).tolist()))
        assert set(counts) == set(itertools.permutations(range(n)))
        assert sum((c - 90) ** 2 / 90 for c in counts.values()) < 20.5  # chi squared, p = 0.001


# The file -----------------------------------------------------------------------------
def test_participants_are_assigned_in_blocks_and_reproducibly(tmp_path):
    orders, codes = williams(3).T, [f"P{k}" for k in range(1, 25)]
    given, again, other = (
        [assign(tmp_path / name, code, orders, seed=seed) for code in codes]
        for name, seed in (("a", 7), ("b", 7), ("c", 8))
    )
    for at in range(0, 24, 6):
        assert sorted(given[at : at + 6]) == sorted(orders.tolist())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert [assigned(tmp_path / "a", code) for code in codes] == given == again
    assert given[:6] != given[6:12] and other != given
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "c"]  # no lock is left
    twice = [assign(tmp_path / "d", f"P{k}", ["A", "A", "B"]) for k in range(6)]
    assert sorted(twice[:3]) == sorted(twice[3:]) == ["A", "A", "B"]


def test_a_participant_is_assigned_once(tmp_path):
    path = tmp_path / "new" / "orders.json"
    order = assign(path, "P01", ["A", "B"], seed=1)
    before = path.read_bytes()
    why = f"participant P01 has the order '{order}' already; read it with assigned"
    for says, who, orders, seed in (
        (why, "P01", ["A", "B"], 1),
        ("begun with seed = 1 and orders", "P02", ["A", "B"], 2),
        (r"orders = \['A', 'B'\]; give these", "P02", ["A"], 1),
        ("there is 'P01'", "p01", ["A", "B"], 1),
    ):
        refused(BadValue, says, assign, path, who, orders, seed=seed)
    refused(UnknownName, "'P02' has no order yet; call assign first", assigned, path, "P02")
    assert path.read_bytes() == before


def test_a_file_that_another_has_for_long(tmp_path, monkeypatch):
    path, lock = tmp_path / "orders.json", tmp_path / "orders.json.lock"
    waiting = threading.Thread(target=assign, args=(path, "P01", ["A"]))
    monkeypatch.setattr(assignments, "WAIT", 0.1)
    with ExitStack() as stack:
        assert safe_files.taken(stack, lock)
        refused(SinkError, "in use by another", assign, path, "P01", ["A"])
        monkeypatch.setattr(assignments, "WAIT", 60.0)
        waiting.start()
        waiting.join(0.1)
        assert waiting.is_alive() and not path.exists()
        assign(tmp_path / "other", "P09", ["A"])
        (tmp_path / "other").rename(path)
    waiting.join(30)
    assert assigned(path, "P01") == assigned(path, "P09") == "A", "read when the lock is there"
    lock.write_bytes(b"")  # as a killed process leaves it
    assert assign(path, "P02", ["A"]) == "A"


@pytest.mark.parametrize(
    "change, why",
    [
        (lambda t: t["participants"].update(P01="C"), "was edited: participant 'P01'"),
        (lambda t: t["participants"].pop("P01"), "was edited: participant 'P02'"),
        (lambda t: t.update(orders=[]), "was edited"),
        (lambda t: t.update(seed=-1), "no assignment of participants: seed must be"),
        (lambda t: t.pop("orders"), "no assignment of participants: orders is missing"),
        (lambda t: t.update(participants=[]), "participants must be a table"),
    ],
)
def test_a_file_that_was_edited_is_refused(tmp_path, change, why):
    path = tmp_path / "orders.json"
    assert len({assign(path, f"P0{k}", ["A", "B", "C"], seed=1) for k in (1, 2, 3)}) == 3
    table = json.loads(path.read_text())
    change(table)
    path.write_text(json.dumps(table))
    for call in (
        lambda: assigned(path, "P03"),
        lambda: assign(path, "P04", ["A", "B", "C"], seed=1),
    ):
        refused(SinkError, why, call)


DEEP: list = []
for _ in range(100_000):
    DEEP = [DEEP]


def test_a_link_is_not_replaced(tmp_path):
    """A write through it would leave the file that others use as it was."""
    path, link = tmp_path / "orders.json", tmp_path / "link.json"
    refused(SinkError, "cannot read .*orders.json", assigned, path, "P01")
    path.write_text("[")
    refused(SinkError, "is no assignment", assigned, path, "P01")
    path.unlink()
    assign(path, "P01", ["A", "B"], np.int64(1))
    link.symlink_to(path)
    refused(SinkError, "link.json is a link", assign, link, "P02", ["A", "B"], 1)
    assert link.is_symlink() and assigned(link, "P01") == assigned(path, "P01")


@pytest.mark.parametrize(
    "wrong, error, why",
    [
        ({"participant": "Anna Smith"}, BadValue, "must be a code"),
        ({"orders": []}, BadValue, "orders is empty; give at least one"),
        ({"orders": "AB"}, BadValue, "orders = 'AB' must be a list"),
        ({"orders": [float("nan")]}, BadValue, "names, numbers or lists of them, and finite"),
        ({"orders": [object()]}, BadValue, "names, numbers or lists of them"),
        ({"seed": -1}, BadValue, "seed = -1"),
        ({"seed": 1.5}, BadValue, "seed = 1.5 must be a whole number"),
        ({"path": 3}, BadValue, "path = 3 must be"),
        ({"path": ""}, BadValue, "path = '.' is a folder; give the name of a file"),
        ({"path": "/"}, BadValue, "path = '/' is a folder"),
        ({"orders": DEEP}, BadValue, "orders are nested too deeply"),
        ({"path": "/dev/null/orders"}, SinkError, "cannot make the folder"),
    ],
)
def test_an_assignment_that_makes_no_sense(tmp_path, wrong, error, why):
    usual = {"path": tmp_path / "orders.json", "participant": "P01", "orders": ["A", "B"]}
    refused(error, why, lambda: assign(**usual | wrong))
    assert os.listdir(tmp_path) == []
