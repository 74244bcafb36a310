"""Orders of conditions: Williams squares, randomised blocks, and the file that assigns
participants.
"""

import itertools
import json
import os
import subprocess
import sys
import threading
import time
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
@pytest.mark.parametrize("n", [*range(2, 41), 101, 200])
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


def test_a_williams_square_that_is_none():
    for n in (1, 0, -4, 1001):
        refused(BadValue, f"williams: n = {n} must be a number of conditions", williams, n)
    refused(BadValue, "williams: n = 2.5 must be a whole number", williams, 2.5)


# Randomised blocks --------------------------------------------------------------------
def orders_of(n, shuffle, seeds, repeats=4):
    items = tuple((Rate(str(i), ("q",), Stimulus("a")), None) for i in range(n))
    design = ConstantStimuli(items, repeats, shuffle)
    return np.array([design.init(seed)["order"] for seed in seeds])


@pytest.mark.parametrize("n", [2, 3, 5])
def test_blocks_have_each_condition_once_and_no_repeat_across_the_border(n):
    found = orders_of(n, "apart", range(120))
    assert (np.sort(found.reshape(120, 4, n)) == np.arange(n)).all()
    assert (found[:, 1:] != found[:, :-1]).all()
    plain = orders_of(n, "each", range(120))
    assert (plain[:, 1:] == plain[:, :-1]).any()
    kept = (plain[:, 1:] != plain[:, :-1]).all(axis=1)  # where there is nothing to redraw
    assert (found[kept] == plain[kept]).all() and kept.any()


def test_every_order_of_a_block_is_as_likely():
    """Also of the second, which is drawn anew in a third of the sessions."""
    second = orders_of(3, "apart", range(1800), repeats=2)[:, 3:]
    counts = Counter(map(tuple, second.tolist()))
    assert set(counts) == set(itertools.permutations(range(3)))
    assert sum((c - 300) ** 2 / 300 for c in counts.values()) < 20.5  # chi squared, p = 0.001


def test_one_condition_cannot_be_kept_apart():
    one = ((Rate("a", ("q",), Stimulus("a")), None),)
    refused(BadValue, "or, of two items or more, apart", ConstantStimuli, one, 2, "apart")
    assert ConstantStimuli(one, 1, "apart").init(1)["order"] == [0]


# The file -----------------------------------------------------------------------------
def test_participants_are_assigned_in_blocks_and_reproducibly(tmp_path):
    orders = williams(3).T
    for name in ("a", "b"):
        given = [assign(tmp_path / name, f"P{k}", orders, seed=7) for k in range(1, 25)]
        for at in range(0, 24, 6):
            assert sorted(given[at : at + 6]) == sorted(orders.tolist())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert [assigned(tmp_path / "a", f"P{k}") for k in range(1, 25)] == given
    assert given[:6] != given[6:12]
    other = [assign(tmp_path / "c", f"P{k}", orders, seed=8) for k in range(1, 25)]
    assert other != given
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "c"]  # no lock is left
    twice = [assign(tmp_path / "d", f"P{k}", ["A", "A", "B"]) for k in range(6)]
    assert sorted(twice[:3]) == sorted(twice[3:]) == ["A", "A", "B"]


def test_a_participant_is_assigned_once(tmp_path):
    path = tmp_path / "new" / "orders.json"
    order = assign(path, "P01", ["A", "B"], seed=1)
    before = path.read_bytes()
    why = f"participant P01 has the order '{order}' already; read it with assigned"
    refused(BadValue, why, assign, path, "P01", ["A", "B"], seed=1)
    refused(BadValue, "begun with seed = 1 and orders", assign, path, "P02", ["A", "B"], seed=2)
    refused(BadValue, r"orders = \['A', 'B'\]; give these", assign, path, "P02", ["A"], seed=1)
    refused(UnknownName, "'P02' has no order yet; call assign first", assigned, path, "P02")
    assert path.read_bytes() == before


PROCESS = """
import sys, time
from stimlib.errors import BadValue
from stimlib.experiments.assignments import assign
path, begin, *codes = sys.argv[1:]
time.sleep(max(0.0, float(begin) - time.time()))
for code in codes:
    try:
        print(code, assign(path, code, ["A", "B", "C"], seed=3))
    except BadValue as e:
        print(code, "refused" if "already" in str(e) else e)
"""


def test_two_experimenters_at_once(tmp_path):
    """Both want the same participants, and each some of their own."""
    path, both = tmp_path / "orders.json", [f"P{k}" for k in range(12)]
    own = {"X": [f"X{k}" for k in range(12)], "Y": [f"Y{k}" for k in range(12)]}
    begin = str(time.time() + 3)
    runs = {
        who: subprocess.Popen(
            [
                *(sys.executable, "-c", PROCESS, str(path), begin),
                *itertools.chain(*zip(both, codes, strict=True)),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )
        for who, codes in own.items()
    }
    said = {}
    for who, run in runs.items():
        out, err = run.communicate(timeout=120)
        assert (run.returncode, err) == (0, "")
        said[who] = dict(line.split(" ", 1) for line in out.splitlines())
    people = json.loads(path.read_text())["participants"]
    assert len(people) == 36 and Counter(people.values()) == {"A": 12, "B": 12, "C": 12}
    for code in both:
        answers = sorted((said["X"][code], said["Y"][code]))
        assert answers == sorted([people[code], "refused"]), code
    for who, codes in own.items():
        assert [said[who][c] for c in codes] == [people[c] for c in codes]
    assert sorted(os.listdir(tmp_path)) == ["orders.json"]


def test_a_file_that_another_has_for_long(tmp_path, monkeypatch):
    path, lock = tmp_path / "orders.json", tmp_path / "orders.json.lock"
    monkeypatch.setattr(assignments, "WAIT", 0.1)
    with ExitStack() as stack:
        assert safe_files.taken(stack, lock)
        refused(SinkError, "in use by another process; try again", assign, path, "P01", ["A"])
        assert not path.exists()
        monkeypatch.setattr(assignments, "WAIT", 60.0)
        waiting = threading.Thread(target=assign, args=(path, "P01", ["A"]))
        waiting.start()
        time.sleep(0.1)
        assert not path.exists()
    waiting.join(30)
    assert assigned(path, "P01") == "A"
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
    given = [assign(path, f"P0{k}", ["A", "B", "C"], seed=1) for k in (1, 2, 3)]
    assert len(set(given)) == 3
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
    assign(path, "P01", ["A", "B"], np.int64(1))
    link.symlink_to(path)
    refused(SinkError, "link.json is a link; give the path", assign, link, "P02", ["A", "B"], 1)
    assert link.is_symlink() and assigned(link, "P01") == assigned(path, "P01")
    assign(path, "P02", ["A", "B"], 1)


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


def test_a_file_that_is_not_there_or_no_json(tmp_path):
    refused(SinkError, "cannot read .*orders.json", assigned, tmp_path / "orders.json", "P01")
    (tmp_path / "orders.json").write_text("[")
    refused(SinkError, "is no assignment", assigned, tmp_path / "orders.json", "P01")
