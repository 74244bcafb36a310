"""The audio thread of a shared page in node: sources, changes, fades, other rates."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from live.node import HERE, LIVE, told
from scipy.interpolate import CubicHermiteSpline

from stimlib import Input, Scene
from stimlib.live.inputs import Inputs

FS, MOST = 8000, 128


def source(kind, low=-1.0, high=3.0, freq=5.0, value=0.5):
    return {"from": kind, "finger": 0, "low": low, "high": high, "freq": freq, "value": value}


def started(calls, say=None, rate=FS, motion=(), forces=(), **sources):
    names = list(sources)
    o = {
        "fs": FS,
        "inputs": names,
        "outputs": [2.0, 4.0, 1.0, 1.0, 1.0, 1.0][: len(names)],
        "lifted": list(forces),
        "held": [f"{what}{k}" for k in range(len(names)) for what in ("x", "on")],
        "motion": list(motion),
        "sources": sources,
    }
    begin = {"start": {"params": [], "sources": sources, "session": 1}}
    say = {0: [begin]} | (say or {})
    how = json.dumps({"rate": rate, "o": o, "calls": calls, "say": say})
    made = told(HERE / "thread.js", LIVE / "web" / "worklet.js", how)
    return np.array(made["heard"]), np.array(made["rows"]), made


def test_a_sine_and_the_change_to_another_in_100_ms():
    other, cut = source("sine", 0.0, 0.5, 8.0), 10 * MOST
    _, rows, _ = started(30, {10: [{"choose": {"x": other}}]}, x=source("sine"))
    i = np.arange(rows.shape[1])
    before = 1 - 2 * np.cos(2 * np.pi * 5 * i / FS)
    after = 0.25 - 0.25 * np.cos(2 * np.pi * 8 * i / FS)
    part = np.clip((i - cut + 1) / (0.1 * FS), 0, 1)
    changed = before[cut - 1] + part * (after - before[cut - 1])
    np.testing.assert_allclose(rows[0], np.where(i < cut, before, changed), atol=1e-12)


DELAY = 1 / 60 + MOST / FS + 0.005  # s


def move(t, u, on=1):
    return {"move": {"finger": 0, "u": u, "v": 0.0, "p": 1.0, "on": on, "t": t}}


def test_a_finger_is_where_its_time_stamps_say_a_delay_later():
    """Two reports come with each block, as the thread hears of them."""
    say = {k: [move(16 * k - 8, 0.032 * k - 0.016), move(16 * k, 0.032 * k)] for k in range(1, 31)}
    _, rows, made = started(32, say, x=source("u"))
    newest = [0, 0, 0, *(int((16e-3 * (k + 1) - DELAY) / 0.008) * 8 for k in range(3, 32))]
    assert made["times"] == newest and made["moved"] == [t for t in newest if t]
    u = 2 * (np.arange(rows.shape[1]) / FS - DELAY)
    settled = slice(int(0.2 * FS), 31 * MOST)
    np.testing.assert_allclose(rows[0, settled], -1 + 4 * u[settled], atol=1e-9)


def test_a_finger_that_comes_late_is_caught_up_with_and_lands_at_once():
    """What a curve has still to go when its report comes, it goes in 0.15 s."""
    _, rows, _ = started(20, {5: [move(1, 0.5)]}, x=source("u"))
    i, begun = np.arange(rows.shape[1]), 5 * MOST
    u = 0.5 * np.clip(((i - begun) / FS - DELAY) / 0.15 + 1, 0, 1)
    part = np.clip((i + 1 - begun) / (0.15 * FS), 0, 1)
    u = np.where(i < begun, 0.0, u - u[begun - 1] * (1 - part) ** 2 * (1 + 2 * part))
    np.testing.assert_allclose(rows[0], -1 + 4 * u, atol=1e-5)
    contact = {"on": source("contact"), "x": source("u")}
    _, rows, _ = started(40, {5: [move(1, 0.5)], 20: [move(241, 0.5, 0)]}, **contact)
    down, up = (int(np.ceil((begin * MOST / FS + DELAY) * FS)) for begin in (5, 20))
    assert np.array_equal(np.flatnonzero(np.diff(rows[0])), [down - 1, up - 1])
    np.testing.assert_allclose(rows[1], np.where(np.arange(40 * MOST) < down, -1, 1))


class Followed:
    """In the place of the smoothing, which the thread of these tests has not either."""

    def process(self, x):
        return x.copy()


CHOSEN = {
    "on": source("contact"),
    "a": source("u"),
    "b": source("v", -2.0, 2.0),
    "c": source("pressure", 0.0, 1.0),
    "d": source("value", value=0.25) | {"finger": 1},  # d and e are forces
    "e": source("pressure", 0.5, 1.5) | {"finger": 1},
}


@pytest.mark.parametrize("names", ["onabcde", "abd"], ids=["contact", "none"])
def test_the_thread_moves_its_inputs_as_a_live_page_does(names, monkeypatch):
    """Two fingers that move, land, leave and stop, with reports that come late, in the
    wrong order, and by a clock that is later and later; sources that are chosen anew.
    """
    sources = {n: s for n, s in CHOSEN.items() if n in names}
    rng, say, calls = np.random.default_rng(6), {}, 280
    for k in range(1, calls):
        begin, late = 1e3 * k * MOST / FS, 80 < k < 200 and 30 <= k % 40 < 38
        for finger in (0, 1) if k % 7 else (0,):
            t = begin - rng.uniform(4.0, 16.0) - 0.15 * k - 20.0 * (k % 31 == 0)
            m = {"finger": finger, "u": 0.5 + 0.4 * np.sin(0.05 * k), "v": rng.uniform()}
            m |= {"p": rng.uniform(0.1, 1.0), "on": int(k % 40 > 3), "t": t}
            if not late and k % 90 < 80:
                say.setdefault(k, []).append({"move": m})
    for k, name, new in [
        (45, "a", source("v", 0.0, 1.0)),
        (150, "d", source("u") | {"finger": 1}),
        (230, "a", source("u", 0.0, 2.0) | {"finger": 1}),
    ]:
        sources = sources | {name: new}
        say.setdefault(k, []).append({"choose": sources})
    first = {n: s for n, s in CHOSEN.items() if n in names}
    _, rows, _ = started(calls, say, forces="de", **first)
    clock = SimpleNamespace(now=0.0, perf_counter=lambda: clock.now)
    monkeypatch.setattr("stimlib.live.inputs.time", clock)
    scene = Scene({n: 1.0 * Input(n, "N" if n in "de" else "m") for n in first})
    inputs = Inputs(scene, FS, dict.fromkeys(first, (0.0, 1.0)), delay=DELAY)
    inputs.sources, inputs._follow, made = dict(first), Followed(), []
    inputs._see_touch()
    for k in range(calls):
        clock.now = k * MOST / FS
        for what, m in (pair for d in say.get(k, []) for pair in d.items()):
            if what == "move":
                inputs.move(**m)
            else:
                for name in [n for n, s in m.items() if s != inputs.sources[n]]:
                    inputs.choose(name, **m[name])
        made.append(inputs.columns(k * MOST, MOST))
    made = np.concatenate(made, axis=1)
    assert np.ptp(made, axis=1).min() > 0.5
    np.testing.assert_allclose(rows[: len(first), : made.shape[1]], made, atol=1e-9)


def test_another_output_is_heard_after_a_fade_and_all_ends_with_one():
    say = {10: [{"listen": 1}], 25: [{"stop": True}]}
    y, _, made = started(40, say, a=source("value", value=1.0), b=source("value", value=-2.0))
    assert made["ended"] == 1
    np.testing.assert_allclose(y[[9 * MOST, 20 * MOST]], [1.0 / 2, -2.0 / 4])  # of full scale
    assert np.abs(np.diff(y)).max() < 4 * 0.5 / (0.02 * FS)  # the first is of 3 samples
    assert not y[0] > 0.01 and not y[-MOST:].any()


def test_a_session_begins_as_the_one_before_it_did():
    """One that interrupts another after its fade of 20 ms, another from silence."""
    sources = {"x": source("value", value=1.0)}
    begin = [{"start": {"params": [], "sources": sources, "session": 2}}]
    y, _, _ = started(60, {10: begin, 30: [{"stop": True}], 40: begin}, **sources)
    assert y[: 10 * MOST].max() == 0.5
    for first in (12 * MOST, 40 * MOST):
        assert np.array_equal(y[first : first + 10 * MOST], y[: 10 * MOST])
    y, _, made = started(60, {10: begin, 11: [{"stop": True}]}, **sources)  # within the fade
    assert made["ended"] == 2 and not y[13 * MOST :].any()


def test_another_rate_reads_a_cubic_polynomial_through_four_samples():
    x = np.random.default_rng(3).standard_normal(1000)
    y, rows, made = started(60, rate=48000, motion=x, x=source("given"))
    assert made["ended"] == 1 and rows[0].tobytes() == x.tobytes() and not y[6000:].any()
    places = np.arange(y.size) / 6 - 2
    wanted = CubicHermiteSpline(np.arange(1000), x, np.gradient(x))(places) / 2
    middle = slice(1000, 5000)  # after the fade
    np.testing.assert_allclose(y[middle], wanted[middle], atol=1e-9)
