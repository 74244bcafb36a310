"""The log of a session: what it holds replays to the delivered samples, bit for bit,
and nothing in it is trusted.
"""

import dataclasses as dc
import hashlib
import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from devices.servers import Jackd, begun, needs_jack
from hypothesis import given, settings, strategies as st
from refusals import refused

import stimlib
from stimlib import Input, Param, Scene, constant
from stimlib.blocks import timeline, white_noise
from stimlib.checks.evidence import Asked
from stimlib.checks.session import verify_log
from stimlib.devices.null import NullSink
from stimlib.devices.sources import Live
from stimlib.errors import BadValue, FaultError, SinkError, StimlibError, UnitError
from stimlib.files import audio as file
from stimlib.files.log_reader import read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.files.log_writer import LogWriter, header
from stimlib.motion.generators import minimum_jerk
from stimlib.run.processor import Change
from stimlib.run.safety import GAIN, Safety, protect, to_device
from stimlib.scenes import bumps, squeeze, viscoelastic

FS = 8000.0


def spring():
    """Two outputs, one of them noisy, with a parameter."""
    force = Param("k", 1000.0, "N/m") * Input("x", "m")
    return Scene({"force": force, "noisy": force + constant(2.0, "N") * white_noise(seed=3)})


def play(
    folder,
    scene,
    safety,
    x,
    *,
    sets=(),
    lost=(),
    channels=None,
    seed=5,
    params=None,
    blocks=None,
    ahead=False,
    **how,
):
    """What a sink does, in odd blocks; sets (index, name, value, ramp in samples), lost
    (index, frames). The frames delivered.
    """
    n = x.shape[1]
    proc = stimlib.compile(protect(scene, safety), FS, seed=seed)
    head = header(
        scene, safety, FS, seed=seed, params=params, channels=channels, device="by hand", block=64
    )
    numbers = [-1 if c is None else proc.outputs.index(c) for c in head["channels"]]
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    proc.process(np.zeros((len(x), 0)))
    rng = np.random.default_rng(1)
    told = [
        (at, "set", {"name": name, "value": value, "ramp": ramp}) for at, name, value, ramp in sets
    ]
    told += [(at, "lost", {"frames": frames}) for at, frames in lost]
    told.sort(key=lambda e: e[0])
    gone = np.zeros(n, bool)
    for at, frames in lost:
        gone[at : at + frames] = True
    edges = sorted({0, n, *(e[0] for e in told), *(a + f for a, f in lost)})
    given, at = [], 0
    with LogWriter(folder, head, record=how.get("record", False)) as log:
        if ahead:
            for i, _, data in [e for e in told if e[1] == "lost"]:
                log.event(i, "lost", **data)
        while at < n:
            for i, kind, data in told:
                if i == at and kind == "set":
                    proc.set(data["name"], data["value"], data["ramp"] / FS)
                if i == at and not (ahead and kind == "lost"):
                    log.event(i, kind, **data)
            stop = min(
                [e for e in edges if e > at]
                + [at + int(rng.choice([1, 7, 64, 100, 1000] if blocks is None else blocks))]
            )
            log.motion(np.ascontiguousarray(x[:, at:stop]))
            frames = to_device(
                proc.process(np.ascontiguousarray(x[:, at:stop])),
                safety.scales(proc.outputs),
                numbers,
            )
            if not gone[at]:
                log.delivered(frames)
                given.append(frames)
            at = stop
        if how.get("report", True):
            missing = int(gone.sum())
            log.close({"produced": n, "delivered": n - missing, "lost": missing})
    return np.concatenate(given)


def motion(n, inputs=1):
    t = np.arange(n) / FS
    return np.stack([0.02 * np.sin(2 * np.pi * (3 + i) * t) for i in range(inputs)])


SAFETY = Safety(full_scale=16.0, slew=4000.0)
SETS = [
    (0, GAIN, 1.0, 160),
    (777, "k", 1500.0, 333),
    (900, "k", 300.0, 1),
    (5003, "k", 800.0, 160),
    (7800, GAIN, 0.0, 160),
]
LOST = [(1200, 77), (2001, 500), (3999, 1), (7999, 1)]


@pytest.fixture
def session(tmp_path):
    folder = tmp_path / "a.stimlog"
    frames = play(
        folder,
        spring(),
        SAFETY,
        motion(8000),
        sets=SETS,
        lost=LOST,
        channels=["noisy", None, "force", "noisy"],
    )
    return folder, frames


# -- replay


def test_a_session_with_changes_and_losses_replays(session, tmp_path):
    folder, frames = session
    log = read_log(folder)
    assert (log.frames, log.logged, log.lost, log.channels) == (8000, 8000, LOST, (1, -1, 0, 1))
    assert (
        log.motion.shape == (8000, 1)
        and np.array_equal(log.motion.T, motion(8000))
        and log.notes == []
    )
    assert log.changes == [(at, name, value, ramp / 8000) for at, name, value, ramp in SETS]
    for block in (1, 17, 64, 8192):
        found = replay(log, tmp_path / f"{block}.wav", block)
        assert found.matches and found.wrong == [] and (found.frames, found.lost) == (8000, 579)
        assert found.spans == len(log.spans) >= 4
        again = np.concatenate([f for _, f, given in delivered(log, block) if given])
        assert again.tobytes() == frames.tobytes()
    assert (tmp_path / "1.wav").read_bytes() == (tmp_path / "8192.wav").read_bytes()
    y, sidecar = file.read(tmp_path / "17.wav")
    assert np.array_equal(y, (frames.astype(float) * [16, 1, 16, 16]).T)
    assert [c["name"] for c in sidecar["channels"]] == ["noisy", "channel1", "force", "noisy"]
    assert (
        sidecar["lost"] == [{"at": a, "frames": n} for a, n in LOST] and np.abs(frames).max() == 1.0
    )
    at = [a for a, f, given in delivered(log, 100) if given and len(f)]
    assert at == sorted(at)
    hidden = [(a, len(f)) for a, f, given in delivered(log, 100) if not given]
    assert sum(n for _, n in hidden) == 579 and all(
        any(b <= a < b + n for b, n in LOST) for a, _ in hidden
    )
    told = lines_of(folder)
    # the last change told first
    rewrite(folder, sorted(told, key=lambda e: -e["at"] * (e["kind"] == "set")))
    again = read_log(folder)
    assert again.changes == log.changes and replay(again).matches


def test_each_channel_of_a_replay_has_the_full_scale_of_its_output(tmp_path):
    scene = Scene(
        {"force": constant(1000.0, "N/m") * Input("x", "m"), "place": 1.0 * Input("x", "m")}
    )
    frames = play(
        tmp_path / "a",
        scene,
        Safety({"force": 16.0, "place": 0.1}),
        motion(1000),
        sets=[(0, GAIN, 1.0, 160)],
    )
    replay(read_log(tmp_path / "a"), tmp_path / "a.wav")
    y, sidecar = file.read(tmp_path / "a.wav")
    assert [(c["unit"], c["full_scale"]) for c in sidecar["channels"]] == [("N", 16.0), ("m", 0.1)]
    assert np.array_equal(y, (frames.astype(float) * [16.0, 0.1]).T)


def test_the_log_says_what_was_delivered_whatever_the_block(tmp_path):
    texts = []
    for i, blocks in enumerate(([1], [64], [5000], None)):
        folder = tmp_path / f"{i}.stimlog"
        play(
            folder,
            spring(),
            SAFETY,
            motion(5000),
            sets=SETS[:3],
            lost=LOST[:2],
            blocks=blocks,
            ahead=i == 2,
        )
        texts.append({p.name: p.read_bytes() for p in folder.iterdir()})
        lines = texts[-1]["events.jsonl"].splitlines()
        texts[-1]["events.jsonl"] = b"\n".join(
            sorted(lines, key=lambda s: (json.loads(s)["at"], s))
        )
    assert all(t == texts[0] for t in texts)
    spans = read_log(tmp_path / "0.stimlog").spans
    assert max(s.to - s.at for s in spans) <= 2000  # a quarter of a second
    assert all(s.to % 2000 == 0 or s.to in (1200, 2001, 5000) for s in spans)


def test_hashes_are_of_the_float32_frames(tmp_path):
    frames = play(tmp_path / "a", spring(), SAFETY, motion(3000), sets=SETS[:1])
    spans = read_log(tmp_path / "a").spans
    assert [(s.at, s.to) for s in spans] == [(0, 2000), (2000, 3000)]
    assert [s.sha256 for s in spans] == [
        hashlib.sha256(frames[a:b].astype("<f4").tobytes()).hexdigest() for a, b, _ in spans
    ]


def test_start_numbers_that_differ(tmp_path):
    play(
        tmp_path / "a",
        spring(),
        SAFETY,
        motion(2000),
        sets=[(0, GAIN, 1.0, 160)],
        params={"k": 77.0},
    )
    log = read_log(tmp_path / "a")
    assert log.params == {"k": 77.0} and replay(log).matches
    other = dc.replace(log, params={})
    assert not replay(other).matches


def test_a_scene_without_inputs(tmp_path):
    scene = Scene({"noise": constant(3.0, "N") * white_noise(seed=1)})
    play(
        tmp_path / "a",
        scene,
        SAFETY,
        np.zeros((0, 3000)),
        sets=[(0, GAIN, 1.0, 160)],
        lost=[(500, 30)],
    )
    assert not (tmp_path / "a" / "motion.f64").exists()
    log = read_log(tmp_path / "a")
    assert log.frames == 3000 and replay(log).matches and verify_log(log).passed
    not_delivered = {"kind": "gap", "delivered": False}  # without motion a gap can be replayed
    rewrite(
        tmp_path / "a",
        [e | not_delivered if e["kind"] == "lost" else e for e in lines_of(tmp_path / "a")],
    )
    gap = read_log(tmp_path / "a")
    assert gap.lost == log.lost and (replay(gap).frames, replay(gap).lost, replay(gap).matches) == (
        3000,
        30,
        True,
    )


def test_motion_that_is_not_finite_is_kept_and_replays(tmp_path):
    x = motion(4000)
    x[0, 2345] = np.nan
    x[0, 2346] = -np.inf
    frames = play(tmp_path / "a", spring(), SAFETY, x, sets=[(0, GAIN, 1.0, 160)])
    assert np.isfinite(frames).all()
    log = read_log(tmp_path / "a")
    assert np.array_equal(log.motion.T, x, equal_nan=True) and replay(log).matches
    report = verify_log(log)
    assert [c.name for c in report.checks if not c.passed] == ["no fault"]  # and it is told
    assert any(
        "before 2345 only" in text and "not finite" in text for text in report.evidence.skipped
    )


def test_a_gap_ends_what_can_be_replayed(tmp_path):
    x, scene = motion(4000), spring()
    proc = stimlib.compile(protect(scene, SAFETY), FS, seed=5)
    with LogWriter(tmp_path / "a", header(scene, SAFETY, FS, seed=5)) as log:
        y = to_device(proc.process(x), SAFETY.scales(proc.outputs), [0, 1])
        log.motion(x[:, :1000])
        log.delivered(y[:1000])
        # block for block, as the callback tells them
        log.event(1000, "gap", frames=200, delivered=True)
        log.event(1200, "gap", frames=300, delivered=True)
        log.motion(np.ascontiguousarray(x[:, 1500:]))
        log.delivered(y[1500:])
        log.close({"produced": 4000})
    log = read_log(tmp_path / "a")
    assert (log.frames, log.logged) == (1000, 4000)
    assert log.notes == ["a gap of 500 samples at 1000, of which the log knows nothing"]
    found = replay(log)
    assert (found.frames, found.missing, found.wrong, found.matches) == (1000, 3000, [], False)


def test_record_keeps_the_frames(tmp_path):
    frames = play(tmp_path / "a", spring(), SAFETY, motion(3000), sets=SETS[:1], record=True)
    import soundfile

    got, fs = soundfile.read(tmp_path / "a" / "delivered.caf", dtype="float32")
    assert fs == 8000 and np.array_equal(got, frames)


# -- verify


def test_verify_proves_a_session_of_the_squeeze(tmp_path):
    depth = minimum_jerk(depth=0.01)
    x = np.stack([depth(np.arange(16000) / FS), 0.5 * depth(np.arange(16000) / FS)])
    sets = [
        (0, GAIN, 1.0, 160),
        (3333, "A", 0.0, 500),
        (5000, "A", 2.0, 40),
        (12001, "k", 1500.0, 160),
        (15840, GAIN, 0.0, 160),
    ]
    sets += [(12100, "k", 900.0, 2000), (9000, "level", 1.5, 1), (9000, "level", 0.5, 1)]
    play(
        tmp_path / "a",
        squeeze(),
        Safety(full_scale=50.0, peak=40.0),
        x,
        sets=sets,
        lost=[(3000, 64)],
    )
    report = verify_log(read_log(tmp_path / "a"), squeeze())
    assert report.passed, str(report)
    names = {c.name for c in report.checks}
    assert {
        "log: delivered = replay",
        "log: replay = these samples made safe",
        "log: samples as reported",
    } <= names
    assert {"force1: mean part is k x", "force2: vibration law"} <= names
    assert any(n.startswith("force1: Pacinian") for n in report.evidence.numbers)
    skipped = "\n".join(report.evidence.skipped)
    assert "k was changed, so the force over position has no one slope" in skipped
    assert (
        "64 samples were lost, 1 times, first at 3000" in skipped
        and "law of the scene" not in skipped
    )
    report.to_html(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text()
    assert "passed" in page and "Keep the folder of the log, <code>a</code>, whole" in page


@pytest.mark.parametrize(("what", "says"), [("value", 1501.0), ("ramp", 161), ("at", 12002)])
def test_verify_sees_a_session_that_was_played_otherwise(tmp_path, monkeypatch, what, says):
    """The law follows the parameters of the log by itself: a processor that does
    something else is found.
    """
    x = np.stack([minimum_jerk(depth=0.01)(np.arange(16000) / FS)])
    play(
        tmp_path / "a",
        squeeze(fingers=1),
        Safety(50.0),
        x,
        sets=[(0, GAIN, 1.0, 160), (12001, "k", 1500.0, 160)],
    )
    log = read_log(tmp_path / "a")
    honest = Asked.live
    wrong = {
        "value": (12001, "k", 1501.0, 0.02),
        "ramp": (12001, "k", 1500.0, 0.020125),
        "at": (12002, "k", 1500.0, 0.02),
    }
    changes = [Change(*wrong[what])]
    monkeypatch.setattr(
        Asked,
        "live",
        lambda a, name: honest(dc.replace(a, e=dc.replace(a.e, changes=changes)), name),
    )
    failed = {c.name for c in verify_log(log).checks if not c.passed}
    assert failed == {"force1: mean part is k x", "force1: vibration law"}


@pytest.mark.parametrize("law", ["viscoelastic", "bumps"])
@pytest.mark.parametrize("wrong", [None, "value", "at"])
def test_other_laws_follow_changes_too(tmp_path, monkeypatch, law, wrong):
    scene = {"viscoelastic": viscoelastic, "bumps": bumps}[law]()
    x = np.stack(
        [
            (
                0.05 * np.arange(8000) / FS
                if law == "bumps"
                else minimum_jerk(depth=0.01)(np.arange(8000) / FS)
            )
        ]
    )
    half = {
        "viscoelastic": [("firmness", 4567)],
        "bumps": [("A", 4567), ("duty", 5000), ("freq", 3001), ("A", 6500)],
    }[law]
    sets = [(at, name, 0.5 * scene.params[name].value * (at != 6500), 300) for name, at in half]
    play(tmp_path / "a", scene, Safety(full_scale=1000.0), x, sets=[(0, GAIN, 1.0, 160), *sets])
    log = read_log(tmp_path / "a")
    if wrong:  # the law reads the log by itself, so a session that was played otherwise is found
        honest = Asked.live

        def dishonest(a, name):
            some = [
                Change(at + (wrong == "at"), n, v * (1 + 1e-3 * (wrong == "value")), r)
                for at, n, v, r in a.e.changes
            ]
            return honest(dc.replace(a, e=dc.replace(a.e, changes=some)), name)

        monkeypatch.setattr(Asked, "live", dishonest)
    report = verify_log(log)
    assert report.passed == (wrong is None), str(report)
    assert not any("law of the scene" in text for text in report.evidence.skipped)
    assert any(c.group == "d" for c in report.checks)
    if wrong is None:
        report.to_html(tmp_path / "a.html")


def test_verify_sees_another_scene(session):
    refused(BadValue, "session of another scene", verify_log, read_log(session[0]), squeeze())


def test_verify_without_changes_holds_the_law_against_everything(tmp_path):
    x = np.stack([minimum_jerk(depth=0.01)(np.arange(9000) / FS)])
    sets = [(0, "k", 500.0, 1), (0, GAIN, 1.0, 160)]
    play(tmp_path / "a", squeeze(fingers=1), Safety(full_scale=50.0), x, sets=sets)
    report = verify_log(read_log(tmp_path / "a"))
    assert report.passed and not any("law of the scene" in text for text in report.evidence.skipped)
    slope = next(c for c in report.checks if "slope" in c.name)
    assert slope.text.startswith("499.999")
    assert report.evidence.fingers
    report.to_html(tmp_path / "a.html")


# -- what was tampered with is found


def lines_of(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def rewrite(folder, events):
    (folder / "events.jsonl").write_text("".join(json.dumps(e) + "\n" for e in events))


def test_a_tampered_hash_is_found(session):
    folder, _ = session
    events = lines_of(folder)
    i = next(i for i, e in enumerate(events) if e["kind"] == "hash" and e["at"] > 2000)
    digit = events[i]["sha256"][0]
    events[i]["sha256"] = ("0" if digit != "0" else "1") + events[i]["sha256"][1:]
    rewrite(folder, events)
    found = replay(read_log(folder))
    assert not found.matches and found.wrong == [(events[i]["at"], events[i]["to"])]
    report = verify_log(read_log(folder))
    assert [c.name for c in report.checks if not c.passed] == ["log: delivered = replay"]


# the second is in a stretch that was lost
@pytest.mark.parametrize("at", [0, 1250, 1500, 4096, 7900])
def test_a_tampered_byte_of_motion_is_found(session, at):
    folder, _ = session
    path = folder / "motion.f64"
    data = bytearray(path.read_bytes())
    data[8 * at + 6] ^= 0x10  # a bit of the exponent or of the leading digits
    path.write_bytes(data)
    found, start = replay(read_log(folder)), at // 2000 * 2000
    assert not found.matches and found.changed == [(start, start + 2000)]
    # nobody feels it while the gain is 0, or what was lost
    assert bool(found.wrong) == (at not in (0, 1250))
    assert "log: motion as it was written" in [
        c.name for c in verify_log(read_log(folder)).checks if not c.passed
    ]


@pytest.mark.parametrize(
    ("size", "report", "says"),
    [
        (3, True, "motion.f64 has 3 bytes more than the session wrote"),
        (24, True, "has 24 bytes more"),
        (0, True, None),
        (3, False, "the last frame of motion is cut short"),
        (24, False, None),
    ],
)
def test_motion_that_was_appended_is_found_where_the_session_ended(tmp_path, size, report, says):
    play(tmp_path / "a", spring(), SAFETY, motion(3000), sets=SETS[:1], report=report)
    with open(tmp_path / "a" / "motion.f64", "ab") as f:
        f.write(bytes(size))
    log = read_log(tmp_path / "a")
    assert sum("motion" in n for n in log.notes) == (says is not None)
    assert replay(log).matches and (says or "") in str(replay(log))
    failed = [c.name for c in verify_log(log).checks if not c.passed]
    assert failed == (["log: motion as it was written"] if report and size else [])


def test_a_changed_number_or_ramp_is_found(tmp_path):
    folder = tmp_path / "a"
    # no limit hides what was changed
    play(folder, spring(), Safety(full_scale=100.0), motion(8000) + 0.01, sets=SETS)
    clean = lines_of(folder)
    for i in [i for i, e in enumerate(clean) if e["kind"] == "set"]:
        for what, value in (
            ("value", clean[i]["value"] * (1 + 1e-7) + 1e-7),
            ("ramp", clean[i]["ramp"] + 1),
            ("at", clean[i]["at"] + 1),
        ):
            events = [dict(e) for e in clean]
            events[i][what] = value
            rewrite(folder, events)
            assert not replay(read_log(folder)).matches, (i, what)


def test_other_changes_are_found(session):
    folder, _ = session
    clean, head = lines_of(folder), json.loads((folder / "session.json").read_text())
    rewrite(folder, [e for e in clean if e["at"] < 6000])  # the report knows better
    found = replay(read_log(folder))
    assert not found.matches and found.missing == 2000 and "6000" in str(found)
    rewrite(folder, clean[:8] + clean[9:] if clean[8]["kind"] == "hash" else clean)
    losses = [i for i, e in enumerate(clean) if e["kind"] in ("lost", "hash")]
    for i in losses[:-1]:
        rewrite(folder, clean[:i] + clean[i + 1 :])
        refused(SinkError, "lines are missing or moved", read_log, folder)
    rewrite(folder, clean)
    assert replay(read_log(folder)).matches
    (folder / "session.json").write_text(json.dumps(head | {"seed": head["seed"] + 1}))
    assert not replay(read_log(folder)).matches
    for what, value in (("full_scale", 16.1), ("slew", 3999.0)):
        (folder / "session.json").write_text(
            json.dumps(head | {"safety": head["safety"] | {what: value}})
        )
        assert not replay(read_log(folder)).matches and not verify_log(read_log(folder)).passed
    block = next(b for b in head["scene"]["blocks"] if b["class"] == "Param")
    block["fields"]["value"] = 999.0
    (folder / "session.json").write_text(json.dumps(head))
    refused(SinkError, "scene_hash is not that of the scene", read_log, folder)


@pytest.mark.parametrize("what", ["produced", "delivered", "lost"])
@pytest.mark.parametrize("value", [-1, 0, 7999, 2**70, 1.5, "8000", None])
def test_an_edited_count_of_the_report_is_found(session, what, value):
    folder, _ = session
    said = json.loads((folder / "report.json").read_text())
    (folder / "report.json").write_text(json.dumps(said | {what: value}))
    assert "log: samples as reported" in [
        c.name for c in verify_log(read_log(folder)).checks if not c.passed
    ]


def test_motion_that_is_too_short_is_told(session):
    folder, _ = session
    os.truncate(folder / "motion.f64", 8 * 5000 + 3)
    log = read_log(folder)
    assert log.frames == 5000 and log.logged == 8000
    assert any("cut short" in n for n in log.notes) and any(
        "motion ends at sample 5000" in n for n in log.notes
    )
    found = replay(log)
    assert found.wrong == [] and found.missing == 3000 and not found.matches
    assert not verify_log(log).passed


# -- a killed session


def test_every_cut_of_a_log_reads_and_replays_to_its_end(tmp_path):
    folder = tmp_path / "a"
    play(folder, spring(), SAFETY, motion(6000), sets=SETS[:3], lost=LOST[:2], report=False)
    events, x = (folder / "events.jsonl").read_bytes(), (folder / "motion.f64").read_bytes()
    seen = set()
    for cut in range(0, len(events) + 1, 13):
        (folder / "events.jsonl").write_bytes(events[:cut])
        log = read_log(folder)
        assert "no report" in " ".join(log.notes)
        if cut % 11 == 0 or log.frames not in seen:
            found = replay(log)
            assert found.matches and found.frames == log.frames
            seen.add(log.frames)
    assert seen >= {0, 1200, 1277, 2000, 2001, 2501, 4000}
    for cut in range(0, len(x), 4001):
        (folder / "motion.f64").write_bytes(x[:cut])
        found = replay(read_log(folder))
        assert found.wrong == [] and found.frames == min(cut // 8, log.frames)


# -- the writer


def test_the_writer_refuses_what_it_could_not_replay(tmp_path):
    good = header(spring(), SAFETY, FS)
    for change, says in [
        ({"scene_hash": "0" * 64}, "scene_hash"),
        ({"channels": ["nothing"]}, "channels must be names of outputs"),
        ({"channels": []}, "1 to 1024"),
        ({"inputs": ["y"]}, "inputs must be of x"),
        ({"inputs": ["x", "x"]}, "an input is there twice"),
        ({"fs": float("nan")}, "fs must be"),
        ({"safety": {"full_scale": -1}}, "above 0"),
        ({"safety": {"surprise": 1}}, "safety cannot be used"),
        ({"params": {"q": 1.0}}, "no parameter 'q'"),
        ({"params": {"k": float("inf")}}, "finite"),
    ]:
        refused(BadValue, says, LogWriter, tmp_path / "a", good | change)
    assert not (tmp_path / "a").exists()
    with LogWriter(tmp_path / "a", good) as log:
        log.delivered(np.zeros((10, 2), np.float32))
        for call in [
            lambda: log.motion(np.zeros((2, 5))),
            lambda: log.motion(np.zeros((1, 5), np.float32)),
            lambda: log.delivered(np.zeros((5, 3), np.float32)),
            lambda: log.delivered(np.zeros((5, 2))),
            lambda: log.event(9, "lost", frames=3),
            lambda: log.event(10, "lost", frames=86400 * 8000 + 1),
            lambda: log.event(10, "lost", frames=-3),
            lambda: log.event(10, "lost"),
            lambda: log.event(-1, "stop"),
            lambda: log.event(1.5, "stop"),
            lambda: log.event(3, "hash"),
            lambda: log.event(3, "note", value=float("nan")),
            lambda: log.event(3, "note", value=object()),
        ]:
            refused(BadValue, None, call)
        log.event(np.int64(10), "note", value=np.float64(3), n=np.int32(4))
        log.event(500, "lost", frames=100)  # ahead of what was delivered
        refused(BadValue, "frames up to 600 are accounted for", log.event, 550, "lost", frames=100)
    refused(SinkError, "is closed", log.event, 3, "note")
    log.close()
    assert [e.kind for e in read_log(tmp_path / "a").events] == ["note", "hash"]
    refused(SinkError, "there already and not empty", LogWriter, tmp_path / "a", good)
    refused(SinkError, "cannot make the log", LogWriter, tmp_path / "none" / "a", good)


def test_a_full_disk_is_told_and_the_log_stays_readable(mounted):
    folder = mounted("size=256k")
    log = LogWriter(folder / "a", header(spring(), SAFETY, FS, seed=5))
    proc, x = stimlib.compile(protect(spring(), SAFETY), FS, seed=5), motion(640)
    with pytest.raises(SinkError, match="No space left on device") as first:
        for _ in range(1000):
            log.motion(x)
            log.delivered(to_device(proc.process(x), SAFETY.scales(proc.outputs), [0, 1]))
    assert refused(SinkError, None, log.event, 0, "stop") is first.value
    log.close({"produced": 1})  # quietly
    found = replay(read_log(folder / "a"))
    assert found.matches and found.frames > 10000
    log = None


# -- files from others are data


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs") / "a"
    play(folder, spring(), SAFETY, motion(300), sets=SETS[:1], lost=[(100, 10)])
    return folder, {p.name: p.read_bytes() for p in folder.iterdir()}


PLAIN = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
ODD = st.sampled_from([10**400, -(2**63), 1e308, "../../x", "k"])
KEYS = st.sampled_from(["at", "to", "x", "full_scale"])
FLAT = PLAIN | ODD | st.lists(PLAIN | ODD, max_size=3)
JUNK = FLAT | st.dictionaries(KEYS, FLAT, max_size=3)
FILES = ["session.json", "events.jsonl", "motion.f64", "report.json"]


def read_or_refuse(folder):
    """A log is read, or refused by a typed error in one line that names the folder."""
    try:
        log = read_log(folder)
        if log.frames < 10000:
            replay(log)
    except StimlibError as e:
        assert str(folder) in str(e) and len(str(e)) < 1000
        return False
    return True


@settings(max_examples=300)
@given(st.data())
def test_fuzzed_header(small, data):
    folder, files = small
    head = json.loads(files["session.json"])
    where = head
    for _ in range(data.draw(st.integers(0, 3))):
        items = where.items() if isinstance(where, dict) else enumerate(where)
        inner = [k for k, v in items if isinstance(v, dict | list) and v]
        if inner:
            where = where[data.draw(st.sampled_from(inner))]
    key = data.draw(
        st.sampled_from(list(where) if isinstance(where, dict) else list(range(len(where))))
    )
    if data.draw(st.booleans()) and isinstance(where, dict):
        del where[key]
    else:
        where[key] = data.draw(JUNK)
    try:
        text = json.dumps(head)
    except ValueError:  # an integer too long to print
        return
    (folder / "session.json").write_text(text)
    try:
        read_or_refuse(folder)
    finally:
        (folder / "session.json").write_bytes(files["session.json"])


@settings(max_examples=300)
@given(st.data())
def test_fuzzed_events(small, data):
    folder, files = small
    events = lines_of(folder)
    event = data.draw(st.sampled_from(events))
    key = data.draw(st.sampled_from([*event, "kind", "frames", "more"]))
    event[key] = data.draw(JUNK | st.sampled_from(["set", "lost", "gap", "hash", "motion"]))
    try:
        rewrite(folder, events)
        read_or_refuse(folder)
    except ValueError as e:
        assert isinstance(e, StimlibError) or "digits" in str(e)
    finally:
        (folder / "events.jsonl").write_bytes(files["events.jsonl"])


@settings(max_examples=300)
@given(st.sampled_from(FILES), st.integers(0, 2**30), st.binary(max_size=6))
def test_fuzzed_bytes(small, name, at, junk):
    folder, files = small
    data = files[name]
    at %= len(data)
    (folder / name).write_bytes(data[:at] + junk + data[at + len(junk) :])
    try:
        read_or_refuse(folder)
    finally:
        (folder / name).write_bytes(data)


def test_absurd_places(small, tmp_path):
    folder, files = small
    for path in (tmp_path / "none", folder / "session.json", Path("/dev/null"), tmp_path):
        refused(SinkError, None, read_log, path)
    for name in FILES:
        there = tmp_path / name
        shutil.copytree(folder, there)
        (there / name).unlink()
        if name != "report.json":
            refused(SinkError, name, read_log, there)
        os.mkfifo(there / name)  # must not be waited for
        if name == "report.json":
            assert read_log(there).report is None
        else:
            refused(SinkError, name, read_log, there)
    for text in (b"[" * 100_000, b'"' * 3, b"\xff\xfe", b"nan", b"[]", b""):
        (folder / "session.json").write_bytes(text)
        try:
            refused(SinkError, "session.json", read_log, folder)
        finally:
            (folder / "session.json").write_bytes(files["session.json"])
    (folder / "events.jsonl").write_bytes(b"x" * (1 << 21))
    try:
        refused(SinkError, "line 1: longer than", read_log, folder)
    finally:
        (folder / "events.jsonl").write_bytes(files["events.jsonl"])


@pytest.mark.parametrize(
    "text",
    [
        "9**9**9**9",
        "m**(9**9**9)",
        "((m**9)**9)**9",
        "m**1e400",
        "m**400",
        "((((m",
        "m" * 200,
        "m\n(",
    ],
)
def test_a_unit_that_would_be_computed_for_hours(small, text):
    from stimlib.core.units import unit

    refused(UnitError, None, unit, text)
    folder, files = small
    head = json.loads(files["session.json"])
    next(b for b in head["scene"]["blocks"] if b["class"] == "Param")["fields"]["unit"] = text
    (folder / "session.json").write_text(json.dumps(head))
    try:
        refused(SinkError, "scene or safety cannot be used", read_log, folder)
    finally:
        (folder / "session.json").write_bytes(files["session.json"])


@pytest.mark.parametrize("report", [{}, {"produced": 7}, {"produced": "many"}])
def test_a_log_that_lost_its_end_is_no_clean_end(session, tmp_path, report):
    """Whatever its report says: the motion goes further than what was delivered."""
    shutil.copytree(session[0], tmp_path / "a")
    lines = (tmp_path / "a" / "events.jsonl").read_text().splitlines(keepends=True)
    last = max(i for i, line in enumerate(lines) if '"hash"' in line)
    kept = [line for i, line in enumerate(lines) if i < last or '"motion"' in line]
    (tmp_path / "a" / "events.jsonl").write_text("".join(kept))
    (tmp_path / "a" / "report.json").write_text(json.dumps(report))
    log = read_log(tmp_path / "a")
    assert ("the report has no number of samples produced" in log.notes) == (
        report.get("produced") != 7
    )
    assert log.logged == 8000 > log.frames
    assert not replay(log).matches and not verify_log(log).passed


# -- sessions of a real sink


def test_a_sink_with_stalls_stale_hands_and_changes(tmp_path):
    """Everything that may happen to a session: its log replays, and its scene is
    verified on the motion as it was.
    """
    x = np.repeat(minimum_jerk(depth=0.01)(np.arange(16000) / FS)[None], 2, axis=0)
    sink = NullSink(
        squeeze(),
        50.0,
        realtime=False,
        motion=Live(),
        log=tmp_path / "a.stimlog",
        params={"k": 1500.0},
        seed=9,
    )
    with begun(sink, channels=["force2", None, "force1"], block=64):
        at, began, stalled, changed = 0, time.monotonic(), False, False
        while (now := time.monotonic() - began) < 1.6:
            # else the last position is held, and fades
            if not 0.9 < now < 1.1 and at < (to := min(16000, int(FS * now))):
                at += sink.push(dict(zip(sink.proc.inputs, x[:, at:to], strict=True)))
            if now > 0.3 and not stalled:
                sink.pump.write("STALL", 100_000)
                stalled = True
            if now > 0.5 and not changed:
                sink.set("k", 1000.0, ramp=0.05)
                changed = True
            time.sleep(0.004)
        sink.stop()
        sink.wait(3)
    log, report = read_log(tmp_path / "a.stimlog"), sink.report()
    kinds = {e.kind for e in log.events}
    assert {"set", "lost", "stale", "fresh", "stop", "hash", "motion"} <= kinds, kinds
    assert (log.frames, log.logged) == (report.produced, report.produced) and log.notes == []
    assert sum(n for _, n in log.lost) == report.lost > 0.05 * FS
    assert {c.name for c in log.changes} == {GAIN, "k"}
    found = replay(log, tmp_path / "a.rf64")
    assert found.matches and found.lost == report.lost, str(found)
    assert file.read(tmp_path / "a.rf64")[0].shape == (3, report.delivered)
    proven = verify_log(log, squeeze())
    assert proven.passed, str(proven)


def test_a_stimulus_with_ramps_of_its_own_is_not_faded_again(tmp_path):
    """At 5 ms a burst that rises within 10 ms is at half, whatever the sink does before
    it.
    """
    burst = Scene(
        {
            "y": (
                timeline([(0.0, 0.0), (0.01, 1.0), (0.04, 1.0), (0.05, 0.0)])
                * (0.5 + white_noise(seed=1))
            )
        }
    )
    with begun(NullSink(burst, 8.0, clocked=False, log=tmp_path / "a.stimlog"), 0.05) as sink:
        sink.wait()
    log = read_log(tmp_path / "a.stimlog")
    assert replay(log, tmp_path / "a.wav").matches
    y = stimlib.render(burst, {}, FS, 0.05)["y"]
    assert np.array_equal(file.read(tmp_path / "a.wav")[0][0], np.float32(y / 8.0) * 8.0)
    assert [(e.at, e.kind, e.data["frames"]) for e in log.events if e.kind in ("rise", "fall")] == [
        (0, "rise", 160),
        (400, "fall", 160),
    ]
    assert "faded in over 160 frames before sample 0; faded out over 160 frames after" in str(
        sink.report()
    )
    report = verify_log(log)
    assert report.passed and not report.evidence.numbers
    told = [text for text in report.evidence.skipped if "fade" in text]
    assert "160 frames before sample 0" in told[0] and "160 frames from sample 400 on" in told[1]


def test_a_log_with_two_rows_of_motion_swapped_is_refused(tmp_path):
    """Its header names the rows of motion.f64: in another order it is other motion."""
    scene = Scene({"y": Input("a") - 2.0 * Input("b")})
    motion = {"a": np.full(800, 3.0), "b": np.ones(800)}
    with begun(NullSink(scene, 8.0, motion=motion, clocked=False, log=tmp_path / "a.stimlog")) as s:
        s.wait()
    assert verify_log(read_log(tmp_path / "a.stimlog")).passed
    header = tmp_path / "a.stimlog" / "session.json"
    data = json.loads(header.read_text())
    header.write_text(json.dumps(data | {"inputs": data["inputs"][::-1]}))
    assert not verify_log(read_log(tmp_path / "a.stimlog")).passed


def test_a_fade_along_the_samples_is_told(tmp_path):
    with NullSink(spring(), 50.0, clocked=False, motion=Live(), log=tmp_path / "a.stimlog") as sink:
        sink.open(FS)
        sink.push(motion(FS // 2))
        sink.start()
        while sink.pump.index < 1000:
            time.sleep(0.001)
        sink.stop()
    log = read_log(tmp_path / "a.stimlog")
    assert "faded in over the first samples" in str(sink.report()) and "faded out" not in str(
        sink.report()
    )
    assert not {"rise", "fall"} & {e.kind for e in log.events}
    (told,) = verify_log(log).evidence.numbers
    assert (
        told
        == f"{len([c for c in log.changes if c.name == GAIN])} fades on the stimulus, the first"
        " along samples 0 to 160"
    )


@pytest.mark.parametrize("clocked, before", [(True, 0.0), (False, 0.0), (False, 1.0)])
def test_a_sink_whose_motion_is_not_finite(tmp_path, clocked, before):
    x = motion(16000)
    # m: far beyond full scale, so that the guard's fade is that of what was clipped
    x[0, 4999] += before
    x[0, 5000] = np.nan
    scene = Scene({"force": Param("k", 1000.0, "N/m") * Input("x", "m")})
    sink = NullSink(
        scene, 50.0, clocked=clocked, realtime=False, motion={"x": x[0]}, log=tmp_path / "a.stimlog"
    )
    with pytest.raises(FaultError), begun(sink, 1.0, block=64):
        sink.wait(5)
    log = read_log(tmp_path / "a.stimlog")
    assert "fault" in {e.kind for e in log.events} and log.frames == sink.report().produced
    assert replay(log).matches
    assert [c.name for c in verify_log(log).checks if not c.passed] == ["no fault"]


def test_a_sink_whose_disk_is_full_fades_out(mounted):
    small = mounted("size=300k")
    hand = minimum_jerk(depth=0.01)
    sink = NullSink(
        squeeze(),
        50.0,
        realtime=False,
        motion={"x1": hand, "x2": hand},
        log=small / "a.stimlog",
    )
    with pytest.raises(SinkError, match="No space left on device"), begun(sink, 20.0, block=64):
        sink.wait(20)
    log = read_log(small / "a.stimlog")
    found = replay(log)
    assert found.matches and found.frames > 8000 and log.report is None and verify_log(log).passed
    del log  # it maps the motion


@needs_jack
def test_a_session_on_a_jack_server_with_changes_and_losses(tmp_path):
    from stimlib.devices.jack import JackSink

    hand = minimum_jerk(depth=0.01)
    with Jackd(8000, 64) as server:
        motions = {"x1": hand, "x2": hand}
        sink = JackSink(
            squeeze(),
            50.0,
            realtime=False,
            motion=motions,
            log=tmp_path / "a.stimlog",
            server=server.name,
        )
        with begun(sink, 2.0):
            for i in range(8):
                time.sleep(0.2)
                sink.set("k", 1000.0 + 100 * i, ramp=0.05)
                if i == 4:
                    sink.pump.write("STALL", 150_000)
            sink.wait(10)
    log = read_log(tmp_path / "a.stimlog")
    found, report = replay(log), sink.report()
    assert (
        found.matches
        and (found.frames, found.lost) == (report.produced, report.lost)
        and report.lost > 0
    ), str(found)
    assert sum(c.name == "k" for c in log.changes) == 8
    assert verify_log(log, squeeze()).passed
