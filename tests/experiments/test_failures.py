"""What goes wrong around a session: full disks, devices that go, hands, designs and
observers that make no sense.
"""

import errno
import os
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
from devices.servers import Jackd, needs_jack
from experiments.some import TASK, experiment, nothing, observer, simulate, some
from refusals import refused
from waiting import until

import stimlib
from stimlib.devices.sources import Live, Signal, Signals
from stimlib.errors import BadValue, SinkError
from stimlib.experiments import (
    ConstantStimuli,
    Session,
    Simulated,
    Stimulus,
    Timing,
    Trial,
    present,
    read,
    run,
    simulate as observe,
    status,
)
from stimlib.files import read_log, replay
from stimlib.system import safe_files


# The disk -----------------------------------------------------------------------------
def test_a_full_disk_keeps_the_answer_and_stops_before_the_next_stimulus(tmp_path, monkeypatch):
    """In the third trial others take all that is left: its answer has the place of the
    spare file.
    """
    full, shown = [], []
    write, publish = os.write, safe_files.publish

    def no_room(path, *args):
        if full:
            raise SinkError(f"cannot write {path}: No space left on device")
        return publish(path, *args)

    def short(fd, data):  # a part is taken, unless there is the room of the spare file
        if full and (tmp_path / "pair/P01-s1/spare").exists():
            write(fd, data[:20])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(fd, data)

    def show(trial, folder):
        shown.append(trial)
        full.extend([True] * (len(shown) == 3))
        return {}

    monkeypatch.setattr(safe_files, "publish", no_room)
    monkeypatch.setattr("stimlib.experiments.session.os.write", short)
    for resume in (False, True):
        says = "no room for an answer.*resume"
        refused(SinkError, says, simulate, tmp_path, show=show, resume=resume)
        assert len(shown) == 3 == len(read(tmp_path / "pair" / "P01-s1").records)
    monkeypatch.undo()
    answers = [r.answer.values for r in simulate(tmp_path, resume=True).records]
    assert answers == [r.answer.values for r in simulate(tmp_path / "again").records]


def test_a_trial_whose_log_has_no_room_is_not_begun(mounted):
    """Logs of 16 kB each on 1.2 MB: the session stops between two trials, each of them
    with its whole log, and goes on.
    """
    disk = mounted("size=1200k")
    refused(SinkError, "bytes are free", simulate, disk, show="offline")
    folder = disk / "pair" / "P01-s1"
    kept, logs = read(folder).records, sorted(folder.glob("*.stimlog"))
    assert 0 < len(kept) == len(logs) < 8 and all(replay(read_log(log)).matches for log in logs)


# The device ---------------------------------------------------------------------------
@needs_jack
def test_a_device_that_goes_in_the_middle_of_a_trial_leaves_it_to_be_repeated(tmp_path):
    """The server is killed in the third trial: two answers are kept, and the
    presentation is told as one without an answer.
    """
    timing = Timing(interval=0.15, gap=0.05, before=0.0, ramp=0.0)
    made = experiment(fs=8000.0, timing=timing)
    long = replace(made, timing=replace(timing, interval=30.0))
    whole = [(r.trial, r.answer.values) for r in simulate(tmp_path / "whole", made).records]
    data = tmp_path / "data"
    with Jackd(8000, 64) as server:

        def began(sink):
            until(lambda: sink.report().produced > 0)
            server.process.kill()

        def show(trial, folder):
            third = folder.name.startswith("trial-0003")
            given = (long if third else made), trial, "jack", folder, (began if third else None)
            return present(*given, server=server.name, realtime=False)

        refused(SinkError, "server has ended", simulate, data, made, show=show)
    left = read(data / "pair" / "P01-s1")
    assert len(left.records) == 2 and status(left)["unanswered"] == 1
    partly = read_log(left.folder / "trial-0003-1.stimlog")
    assert 0 < partly.frames < 480_000 and replay(partly).matches, "known to the sample"
    again = simulate(data, made, show=lambda trial, folder: {"log": folder.name}, resume=True)
    assert again.records[2].displayed[0]["log"] == "trial-0003-2.stimlog"
    assert [(r.trial, r.answer.values) for r in again.records] == whole


@pytest.mark.parametrize("motion", [Live(), Signals({"x": Signal(1.0), "y": Signal(1.0)})])
def test_a_row_of_positions_means_the_same_input_in_every_trial(motion):
    """The scenes have the same inputs, but the second alone would take y first."""
    x, y = stimlib.Input("x", "m"), stimlib.Input("y", "m")
    made = experiment(
        scenes={"xy": stimlib.Scene({"a": 2.0 * x - y}), "yx": stimlib.Scene({"a": y - x})},
        bounds={},
        motion=motion,
    )
    assert made.inputs == ("x", "y")
    refused(
        BadValue,
        "takes the inputs y, x, the experiment x, y: a row of positions would mean another",
        present,
        made,
        Trial("a", (Stimulus("yx"),), ("softer",)),
        "null",
    )


# Designs and observers ----------------------------------------------------------------


def test_a_design_without_a_trial_is_no_session(tmp_path):
    nothing_at_all = SimpleNamespace(
        init=lambda seed: {}, next=lambda state: None, update=lambda state, answer: state
    )
    made, why = experiment(design=nothing_at_all), "the design of P01, session 1, has no trial"
    refused(BadValue, why, some, tmp_path, 0, made)
    refused(BadValue, why, observe, made, observer, 1)
    training = experiment(design=ConstantStimuli(((TASK, 1.0),), training=True))
    assert observe(training, observer, 2)["outcome"] == []
    assert not list(tmp_path.glob("**/session.json"))


@pytest.mark.parametrize(
    ("who", "why"),
    [
        (
            lambda trial, rng: {}["answer"],
            rf"the observer \({re.escape(__file__)}, line \d+\): KeyError: 'answer'",
        ),
        (lambda trial, rng: {"softer": "first"}, "the observer gives .* an Answer"),
    ],
)
def test_an_error_of_an_observer_is_told_as_its_own(tmp_path, who, why):
    refused(BadValue, why, observe, experiment(), who, 1)
    with pytest.raises(BadValue, match=why), Session(experiment(), tmp_path, "P01") as session:
        run(session, Simulated(session, who), nothing)
