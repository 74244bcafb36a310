"""JSON Schemas of the files: real ones pass, and what stimlib refuses fails."""

import copy
import importlib
import json

import jsonschema
import pytest
from commands import ran
from experiments.some import simulate

import stimlib
from stimlib.cli.schemas import TABLES, schema_of
from stimlib.devices import Calibration, NullSink
from stimlib.scenes import tone
from stimlib.system import fields


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A file of each kind, as JSON data; of the kinds that are lines, all of them."""
    at = tmp_path_factory.mktemp("files")
    stimlib.render(tone(), fs=8000, seconds=0.1).save(at / "a.wav")
    with NullSink(tone(), 10.0, log=at / "a.stimlog", clocked=False) as sink:
        sink.open(8000)
        sink.start(1.2)
        sink.set("freq", 300.0)
        sink.wait()
    Calibration([1, 2], [1, 2j], [0, 0], "N", parts={"sensor": "7"}).save(at / "c.json")
    simulate(at)
    return {
        kind: [json.loads(x if isinstance(x, str) else x.read_bytes()) for x in those]
        for kind, those in {
            "sidecar": [at / "a.wav.json"],
            "log": [at / "a.stimlog" / "session.json"],
            "event": (at / "a.stimlog" / "events.jsonl").read_text().splitlines(),
            "session": [next(at.rglob("trials.jsonl")).with_name("session.json")],
            "trial": next(at.rglob("trials.jsonl")).read_text().splitlines(),
            "calibration": [at / "c.json"],
        }.items()
    }


def validator(kind):
    schema = json.loads(ran(["schema", kind]).stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("kind", TABLES)
def test_what_stimlib_writes_passes(kind, files):
    check = validator(kind)
    assert files[kind]
    for data in files[kind]:
        check.validate(data)
    if kind == "event":
        assert {"set", "hash", "rise", "fall"} <= {data["kind"] for data in files[kind]}


def tables(kind):
    module, _, name = TABLES[kind][1].partition(":")
    found = getattr(importlib.import_module(f"stimlib.{module}"), name)
    return found if kind == "event" else {None: found}


WRONG = (None, True, -1, 0.5, "", "x", [], [None], {}, {"a": None}, 2**70, {"sha256": 1})


@pytest.mark.parametrize("kind", TABLES)
def test_a_schema_refuses_nothing_that_stimlib_takes_and_most_that_it_refuses(kind, files):
    check, missed = validator(kind), 0
    for which, tests in tables(kind).items():
        data = next((d for d in files[kind] if which is None or d["kind"] == which), None)
        for name, test in tests.items() if data else ():
            assert not check.is_valid({k: v for k, v in data.items() if k != name}), name
            for wrong in WRONG:
                changed = copy.deepcopy(data) | {name: wrong}
                assert check.is_valid(changed) or not test(wrong), (name, wrong)
                missed += check.is_valid(changed) and not test(wrong)
    # numbers that are too large for a float, and whole numbers where rates are meant
    assert missed <= 5


def test_each_test_has_a_schema():
    for kind in TABLES:
        for tests in tables(kind).values():
            assert all(test.schema for test in tests.values())
    assert schema_of("log")["properties"]["fs"]["minimum"] == 1
    assert fields.not_negative(0) and fields.not_negative(0.0) and not fields.not_negative(-1)
    assert fields.positive(1) and not fields.positive(0)
    assert fields.maybe(fields.truth).schema["anyOf"][1] == {"type": "null"}
