"""The log of a session: what it holds replays to the delivered samples, bit for bit,
and nothing in it is trusted.
"""

import dataclasses as dc
import hashlib
import json
import shutil
import time
from itertools import product

import numpy as np
import pytest
import soundfile as sf
from devices import servers
from devices.servers import begun
from logged import play
from refusals import refused

import stimlib
from stimlib import BadValue, FaultError, Input, Param, Scene, SinkError, UnitError, constant
from stimlib.blocks import timeline, white_noise
from stimlib.checks import Asked, verify_log
from stimlib.core.units import unit
from stimlib.devices import Live, NullSink
from stimlib.files import LogWriter, audio as file, header, read_log
from stimlib.files.log_replay import delivered, replay
from stimlib.motion.generators import minimum_jerk
from stimlib.run.processor import Change
from stimlib.run.safety import GAIN, Safety, protect, to_device
from stimlib.scenes import bumps, squeeze, viscoelastic

FS = 8000.0


def spring():
    """Two outputs, one of them noisy, with a parameter."""
    force = Param("k", 1000.0, "N/m") * Input("x", "m")
    return Scene({"force": force, "noisy": force + constant(2.0, "N") * white_noise(seed=3)})


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


SCALES = {"force": 16.0, "noisy": 20.0}
FOUR = ["noisy", None, "force", "noisy"]


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    folder = tmp_path_factory.mktemp("played") / "a.stimlog"
    safety = Safety(full_scale=SCALES, slew=4000.0)
    how = {"sets": SETS, "lost": LOST, "channels": FOUR, "record": True}
    return folder, play(folder, spring(), safety, motion(8000), **how)


@pytest.fixture
def session(played, tmp_path):
    """A folder of the log, which a test may change, and the frames delivered."""
    shutil.copytree(played[0], tmp_path / "a.stimlog")
    return tmp_path / "a.stimlog", played[1]


# -- replay


def test_a_session_with_changes_and_losses_replays(session, tmp_path):
    folder, frames = session
    log = read_log(folder)
    assert (log.frames, log.logged, log.lost, log.channels) == (8000, 8000, LOST, (1, -1, 0, 1))
    assert log.motion.shape == (8000, 1) and np.array_equal(log.motion.T, motion(8000))
    assert log.changes == [(at, name, value, ramp / 8000) for at, name, value, ramp in SETS]
    assert log.notes == [] and np.abs(frames).max() == 1.0
    kept, _ = sf.read(folder / "delivered.caf", dtype="float32")
    assert np.array_equal(kept, frames)
    first = hashlib.sha256(frames[:1200].astype("<f4").tobytes()).hexdigest()
    assert tuple(log.spans[0]) == (0, 1200, first)
    for block in (1, 17, 8192):
        found = replay(log, tmp_path / f"{block}.wav", block)
        assert found.matches and found.wrong == [] and (found.frames, found.lost) == (8000, 579)
        assert found.spans == len(log.spans) >= 4
        again = np.concatenate([f for _, f, given in delivered(log, block) if given])
        assert again.tobytes() == frames.tobytes()
    assert (tmp_path / "1.wav").read_bytes() == (tmp_path / "8192.wav").read_bytes()
    y, sidecar = file.read(tmp_path / "17.wav")
    channels = [(c["name"], c["full_scale"]) for c in sidecar["channels"]]
    assert channels == [(n or "channel1", SCALES.get(n, 1.0)) for n in FOUR]
    assert np.array_equal(y, (frames.astype(float) * [s for _, s in channels]).T)
    scene, sounds, _ = file.as_scene(tmp_path / "17.wav")  # two channels have one name
    assert list(scene.outputs) == list(sounds) == [f"channel{k}" for k in (1, 2, 3, 4)]
    assert np.array_equal(list(sounds.values()), y)
    assert sidecar["lost"] == [{"at": a, "frames": n} for a, n in LOST]
    at = [a for a, f, given in delivered(log, 100) if given and len(f)]
    assert at == sorted(at)
    hidden = [(a, len(f)) for a, f, given in delivered(log, 100) if not given]
    assert sum(n for _, n in hidden) == 579
    assert all(any(b <= a < b + n for b, n in LOST) for a, _ in hidden)
    # the last change told first
    edit(folder, EVENTS, lambda e: sorted(e, key=lambda e: -e["at"] * (e["kind"] == "set")))
    again = read_log(folder)
    assert again.changes == log.changes and replay(again).matches


def test_the_log_says_what_was_delivered_whatever_the_block(tmp_path):
    texts, how = [], {"sets": SETS[:3], "lost": LOST[:2]}
    for i, blocks in enumerate(([1], [64], [5000], [1, 7, 64, 100, 1000])):
        folder = tmp_path / f"{i}.stimlog"
        play(folder, spring(), SAFETY, motion(5000), blocks=blocks, ahead=i == 2, **how)
        edit(folder, EVENTS, lambda e: sorted(e, key=lambda e: (e["at"], json.dumps(e))))
        texts.append({p.name: p.read_bytes() for p in folder.iterdir()})
    assert all(t == texts[0] for t in texts)
    spans = read_log(tmp_path / "0.stimlog").spans
    assert max(s.to - s.at for s in spans) <= 2000  # a quarter of a second
    assert all(s.to % 2000 == 0 or s.to in (1200, 2001, 5000) for s in spans)


NOISE = Scene({"noise": constant(3.0, "N") * white_noise(seed=1)})


@pytest.mark.parametrize(
    ("scene", "x", "frames"), [(spring(), motion(4000), 1000), (NOISE, np.zeros((0, 4000)), 4000)]
)
def test_a_gap_ends_what_can_be_replayed(tmp_path, scene, x, frames):
    """But of a scene without inputs, which needs no motion."""
    folder, lost = tmp_path / "a", [(1000, 200), (1200, 300)]
    play(folder, scene, SAFETY, x, sets=SETS[:1], lost=lost)
    log = read_log(folder)
    assert log.lost == lost and replay(log).matches and verify_log(log).passed
    assert (folder / MOTION).exists() == bool(scene.inputs)
    for _ in lost:
        edit(folder, EVENTS, nth("lost", 0, lambda e: e | {"kind": "gap", "delivered": False}))
    if scene.inputs:
        edit(folder, MOTION, lambda data: data[: 8 * 1000] + data[8 * 1500 :])
    gap = read_log(folder)
    assert (gap.frames, gap.logged) == (frames, 4000)
    assert gap.notes == ["a gap of 500 samples at 1000, of which the log knows nothing"]
    found = replay(gap)
    assert (found.frames, found.missing, found.wrong) == (frames, 4000 - frames, [])
    assert found.matches == (not scene.inputs)


# -- verify


def test_verify_proves_a_session_of_the_squeeze(tmp_path):
    depth = minimum_jerk(depth=0.01)(np.arange(16000) / FS)
    sets = [
        (0, GAIN, 1.0, 160),
        (3333, "A", 0.0, 500),
        (5000, "A", 2.0, 40),
        (9000, "level", 1.5, 1),
        (9000, "level", 0.5, 1),
        (12001, "k", 1500.0, 160),
        (12100, "k", 900.0, 2000),
        (15840, GAIN, 0.0, 160),
    ]
    x, safety = np.stack([depth, 0.5 * depth]), Safety(full_scale=50.0, peak=40.0)
    play(tmp_path / "a", squeeze(), safety, x, sets=sets, lost=[(3000, 64)])
    log = read_log(tmp_path / "a")
    refused(BadValue, "another scene", verify_log, log, spring())
    report = verify_log(log, squeeze())
    assert report.passed, str(report)
    assert {
        "log: delivered = replay",
        "log: replay = these samples made safe",
        "log: samples as reported",
        "force1: mean part is k x",
        "force2: vibration law",
    } <= {c.name for c in report.checks}
    assert any(n.startswith("force1: Pacinian") for n in report.evidence.numbers)
    skipped = "\n".join(report.evidence.skipped)
    assert "k was changed" in skipped and "no one slope" in skipped
    assert "64 samples lost, 1 time, first at 3000" in skipped
    assert "law of the scene" not in skipped
    report.to_html(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "passed" in page and "Keep the folder of the log, <code>a</code>, whole" in page


HALVED = {  # what changes, and when
    squeeze: [("k", 12001)],
    viscoelastic: [("firmness", 4567)],
    bumps: [("A", 4567), ("duty", 5000), ("freq", 3001), ("A", 6500)],
}
DISHONEST = {  # a change of the session, as the law is told of it
    "value": lambda c: c._replace(value=c.value * (1 + 1e-3)),
    "at": lambda c: c._replace(at=c.at + 1),
    "ramp": lambda c: c._replace(ramp=c.ramp + 1 / FS),
}


@pytest.mark.parametrize(
    ("law", "wrong"), [*product(HALVED, [None, "value", "at"]), (squeeze, "ramp")]
)
def test_laws_follow_changes_and_see_a_session_that_was_played_otherwise(
    tmp_path, monkeypatch, law, wrong
):
    """The law reads the log by itself, so a processor that does otherwise is found."""
    scene, t = squeeze(fingers=1) if law is squeeze else law(), np.arange(14000) / FS
    x = 0.05 * t[:8000] if law is bumps else minimum_jerk(depth=0.01)(t)
    sets = [
        (at, name, 0.5 * scene.params[name].value * (at != 6500), 300) for name, at in HALVED[law]
    ]
    play(tmp_path / "a", scene, Safety(1000.0), x[None], sets=[(0, GAIN, 1.0, 160), *sets])
    log, honest = read_log(tmp_path / "a"), Asked.live
    if wrong:

        def dishonest(a, name):
            changes = [DISHONEST[wrong](Change(*c)) for c in a.e.changes]
            return honest(dc.replace(a, e=dc.replace(a.e, changes=changes)), name)

        monkeypatch.setattr(Asked, "live", dishonest)
    report = verify_log(log)
    assert report.passed == (wrong is None), str(report)
    assert not any("law of the scene" in text for text in report.evidence.skipped)
    assert any(c.group == "d" for c in report.checks)
    if law is squeeze and wrong:
        failed = {c.name for c in report.checks if not c.passed}
        assert failed == {"force1: mean part is k x", "force1: vibration law"}


# -- what was tampered with is found


EVENTS, HEAD, MOTION, REPORT = "events.jsonl", "session.json", "motion.f64", "report.json"


def edit(folder, name, change):
    """Change the events of a log, the table of one of its files, or its motion."""
    path = folder / name
    if name == MOTION:
        path.write_bytes(change(path.read_bytes()))
    elif name == EVENTS:
        events = [json.loads(line) for line in path.read_text().splitlines()]
        path.write_text("".join(json.dumps(e) + "\n" for e in change(events)))
    else:
        path.write_text(json.dumps(change(json.loads(path.read_text()))))


def flipped(at):
    """A bit of the exponent or of the leading digits of a position is another."""
    at = 8 * at + 6
    return lambda data: data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]


def without_end(events):
    last = max(i for i, e in enumerate(events) if e["kind"] == "hash")
    return [e for i, e in enumerate(events) if i < last or e["kind"] == "motion"]


def nth(kind, n, change):
    """The n-th event of a kind is changed, or goes."""

    def changed(events):
        one = [e for e in events if e["kind"] == kind][n]
        return [e for e in (change(e) if e is one else e for e in events) if e]

    return changed


def safety(**change):
    return lambda head: head | {"safety": head["safety"] | change}


REPLAY, AS_WRITTEN = "log: delivered = replay", "log: motion as it was written"
REPORTED, WHOLE = "log: samples as reported", "log: all samples are there"
EDITED = {  # the file, its change, the checks that fail or the error, and what a replay says
    "a hash": (
        EVENTS,
        nth("hash", 3, lambda e: e | {"sha256": "0" * 64}),
        {REPLAY},
        "of frames 2501 to 3999",
    ),
    **{
        f"{what} of change {n}": (
            EVENTS,
            nth("set", n, lambda e, what=what, more=more: e | {what: e[what] + more}),
            {REPLAY},
            "",
        )
        for n, (what, more) in enumerate(
            [("value", 1e-3), ("ramp", 1), ("value", 1e-3), ("at", 1), ("ramp", 1)]
        )
    },
    **{
        f"no {kind} {n}": (EVENTS, nth(kind, n, lambda e: None), "missing or moved", "")
        for kind, n in (("hash", 0), ("hash", 1), ("hash", 4), ("lost", 0), ("lost", 2))
    },
    "the end of the events": (
        EVENTS,
        lambda events: [e for e in events if e["at"] < 6000],
        {REPORTED, WHOLE, AS_WRITTEN},
        "losses end at 6000",
    ),
    "no last hash": (EVENTS, without_end, {REPORTED, WHOLE}, "losses end at 6000"),
    "the seed": (HEAD, lambda head: head | {"seed": head["seed"] + 1}, {REPLAY}, "0 of 6 hashes"),
    "the full scale": (HEAD, safety(full_scale=16.1), {REPLAY}, "0 of 6 hashes"),
    "the slew": (HEAD, safety(slew=3999.0), {REPLAY}, "1 of 6 hashes"),
    # nobody feels it while the gain is 0, or what was lost
    "motion before the rise": (MOTION, flipped(0), {AS_WRITTEN}, "samples 0 to 2000"),
    "motion that was lost": (MOTION, flipped(1250), {AS_WRITTEN}, "samples 0 to 2000"),
    "motion": (MOTION, flipped(4096), {AS_WRITTEN, REPLAY}, "samples 4000 to 6000"),
    "the last motion": (MOTION, flipped(7900), {AS_WRITTEN, REPLAY}, "samples 6000 to 8000"),
    "less motion": (
        MOTION,
        lambda data: data[: 8 * 5000 + 3],
        {REPLAY, REPORTED, WHOLE, AS_WRITTEN},
        "motion ends at sample 5000",
    ),
    "more bytes": (MOTION, lambda data: data + bytes(3), {AS_WRITTEN}, "3 bytes more"),
    "more rows": (MOTION, lambda data: data + bytes(24), {AS_WRITTEN}, "24 bytes more"),
    **{
        f"{what} {value}": (REPORT, lambda r, w=what, v=value: r | {w: v}, {REPORTED}, says)
        for what, says, values in (
            ("produced", "the report", (-1, 7999, 2**70, "8000", None)),
            ("delivered", "", (7999, None)),
            ("lost", "", (7999, None)),
        )
        for value in values
    },
}


@pytest.mark.parametrize("what", EDITED)
def test_what_was_tampered_with_is_found(session, what):
    folder, _ = session
    name, change, says, told = EDITED[what]
    edit(folder, name, change)
    if isinstance(says, str):
        refused(SinkError, says, read_log, folder)
        return
    log = read_log(folder)
    assert {c.name for c in verify_log(log).checks if not c.passed} == says
    found = replay(log)
    assert told in str(found) and found.matches == (name == REPORT or "more" in what)


# -- a killed session


def test_every_cut_of_a_log_reads_and_replays_to_its_end(tmp_path):
    folder, seen = tmp_path / "a", set()
    play(folder, spring(), SAFETY, motion(6000), sets=SETS[:3], lost=LOST[:2], report=False)
    events, x = (folder / EVENTS).read_bytes(), (folder / MOTION).read_bytes()
    for cut in range(0, len(events) + 1, 13):
        (folder / EVENTS).write_bytes(events[:cut])
        log = read_log(folder)
        assert "no report" in " ".join(log.notes)
        if log.frames not in seen:
            found = replay(log)
            assert found.matches and found.frames == log.frames
            seen.add(log.frames)
    assert seen >= {0, 1200, 1277, 2000, 2001, 2501, 4000}
    for cut in range(0, len(x), 4001):
        (folder / MOTION).write_bytes(x[:cut])
        found = replay(read_log(folder))
        assert found.wrong == [] and found.frames == min(cut // 8, log.frames)
    for more, says in ((24, False), (3, True)):  # motion after the last event is no fault
        (folder / MOTION).write_bytes(x + bytes(more))
        log = read_log(folder)
        assert ("the last frame of motion is cut short" in log.notes) == says
        assert replay(log).matches and verify_log(log).passed


# -- the writer


GOOD = header(spring(), SAFETY, FS)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"scene_hash": "0" * 64}, "scene_hash"),
        ({"channels": ["nothing"]}, "channels must be names"),
        ({"channels": []}, "1 to 1024"),
        ({"inputs": ["y"]}, "inputs must be of x"),
        ({"inputs": ["x", "x"]}, "there twice"),
        ({"fs": float("nan")}, "fs must be"),
        ({"safety": {"full_scale": -1}}, "above 0"),
        ({"safety": {"surprise": 1}}, "safety cannot be used"),
        ({"params": {"q": 1.0}}, "no parameter 'q'"),
        ({"params": {"k": float("inf")}}, "finite"),
    ],
)
def test_a_header_that_could_not_be_replayed_is_refused(tmp_path, change, says):
    refused(BadValue, says, LogWriter, tmp_path / "a", GOOD | change)
    assert not (tmp_path / "a").exists()


def test_the_writer_refuses_what_it_could_not_replay(tmp_path):
    with LogWriter(tmp_path / "a", GOOD) as log:
        log.delivered(np.zeros((10, 2), np.float32))
        for call, *given in [
            (log.motion, np.zeros((2, 5))),
            (log.motion, np.zeros((1, 5), np.float32)),
            (log.delivered, np.zeros((5, 3), np.float32)),
            (log.delivered, np.zeros((5, 2))),
            *((log.event, 10, "lost", n) for n in (86400 * 8000 + 1, -3, None, 1.5)),
            (log.event, 9, "lost", 3),
            (log.event, -1, "stop"),
            (log.event, 1.5, "stop"),
            (log.event, 3, "hash"),
        ]:
            frames = {"frames": given.pop()} if len(given) == 3 else {}
            refused(BadValue, None, call, *given, **frames)
        for value in (float("nan"), object()):
            refused(BadValue, None, log.event, 3, "note", value=value)
        log.event(np.int64(10), "note", value=np.float64(3), n=np.int32(4))
        log.event(500, "lost", frames=100)  # ahead of what was delivered
        refused(BadValue, "frames up to 600", log.event, 550, "lost", frames=100)
    refused(SinkError, "is closed", log.event, 3, "note")
    log.close()
    assert [e.kind for e in read_log(tmp_path / "a").events] == ["note", "hash"]
    refused(SinkError, "^(?!cannot).*not empty", LogWriter, tmp_path / "a", GOOD)
    refused(SinkError, "cannot make the log", LogWriter, tmp_path / "none" / "a", GOOD)
    uneven = GOOD | {"fs": 1000.4}  # delivered.caf would say 1000 Hz
    refused(SinkError, "whole number", LogWriter, tmp_path / "b", uneven, record=True)


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


@pytest.mark.parametrize(
    "text",
    ["9**9**9**9", "m**(9**9**9)", "((m**9)**9)**9", "m**1e400", "m**400", "((((m", "m" * 200]
    + ["m\n("],
)
def test_a_unit_that_would_be_computed_for_hours(text):
    refused(UnitError, None, unit, text)


# -- sessions of a real sink


def test_a_sink_with_stalls_stale_hands_and_changes(tmp_path):
    """Everything that may happen to a session: its log replays, and its scene is
    verified on the motion as it was.  What is on the disk before its end is what a
    process that is killed leaves: it replays up to less than a second before.
    """
    folder = tmp_path / "a.stimlog"
    x = np.repeat(minimum_jerk(depth=0.01)(np.arange(16000) / FS)[None], 2, axis=0)
    how = {"motion": Live(), "params": {"k": 1500.0}, "seed": 9, "realtime": False}
    sink = NullSink(squeeze(), 50.0, log=folder, **how)
    todo = [(0.3, lambda: sink.pump.write("STALL", 100_000))]
    todo += [(0.5, lambda: sink.set("k", 1000.0, ramp=0.05))]
    with begun(sink, channels=["force2", None, "force1"], block=64):
        at, began = 0, time.monotonic()
        while (now := time.monotonic() - began) < 1.6:
            # else the last position is held, and fades
            if not 0.9 < now < 1.1 and at < (to := min(16000, int(FS * now))):
                at += sink.push(dict(zip(sink.proc.inputs, x[:, at:to], strict=True)))
            if todo and now > todo[0][0]:
                todo.pop(0)[1]()
            time.sleep(0.004)
        produced, killed = sink.report().produced, read_log(folder)
        sink.stop()
        sink.wait(30)
    assert killed.report is None and "no report" in " ".join(killed.notes)
    assert replay(killed).matches and produced - killed.frames < FS
    log, report = read_log(folder), sink.report()
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
    ramps = timeline([(0.0, 0.0), (0.01, 1.0), (0.04, 1.0), (0.05, 0.0)])
    burst, folder = Scene({"y": ramps * (0.5 + white_noise(seed=1))}), tmp_path / "a.stimlog"
    sink = servers.played(NullSink(burst, 8.0, clocked=False, log=folder), 0.05)
    log = read_log(folder)
    assert replay(log, tmp_path / "a.wav").matches
    y = stimlib.render(burst, {}, FS, 0.05)["y"]
    assert np.array_equal(file.read(tmp_path / "a.wav")[0][0], np.float32(y / 8.0) * 8.0)
    fades = [(e.at, e.kind, e.data["frames"]) for e in log.events if e.kind in ("rise", "fall")]
    assert fades == [(0, "rise", 160), (400, "fall", 160)]
    said, report = str(sink.report()), verify_log(log)
    assert "in over 160 frames before sample 0" in said and "out over 160 frames after" in said
    assert report.passed and not report.evidence.numbers
    told = [text for text in report.evidence.skipped if "fade" in text]
    assert "160 frames before sample 0" in told[0] and "160 frames from sample 400 on" in told[1]


def test_a_fade_along_the_samples_is_told(tmp_path):
    with NullSink(spring(), 50.0, clocked=False, motion=Live(), log=tmp_path / "a.stimlog") as sink:
        sink.open(FS)
        sink.push(motion(FS // 2))
        sink.start(0.2)
        sink.wait(30)
    log, said = read_log(tmp_path / "a.stimlog"), str(sink.report())
    assert "faded in over the first samples" in said
    assert "rise" not in {e.kind for e in log.events}
    (told,) = (n for n in verify_log(log).evidence.numbers if "fades" in n)
    fades = sum(c.name == GAIN for c in log.changes)
    assert told.startswith(f"{fades} fades on the stimulus") and "0 to 160" in told


@pytest.mark.parametrize("clocked, before", [(True, 0.0), (False, 0.0), (False, 1.0)])
def test_a_sink_whose_motion_is_not_finite(tmp_path, clocked, before):
    x = motion(16000)[0]
    # m: far beyond full scale, so that the guard's fade is that of what was clipped
    x[4999:5001] += [before, np.nan]
    scene = Scene({"force": Param("k", 1000.0, "N/m") * Input("x", "m")})
    how = {"clocked": clocked, "realtime": False, "log": tmp_path / "a.stimlog"}
    sink = NullSink(scene, 50.0, motion={"x": x}, **how)
    refused(FaultError, None, servers.played, sink, 1.0, patience=30, block=64)
    log = read_log(tmp_path / "a.stimlog")
    assert "fault" in {e.kind for e in log.events} and log.frames == sink.report().produced
    assert np.isnan(log.motion[5000:5001, 0]).all() and replay(log).matches
    report = verify_log(log)
    assert [c.name for c in report.checks if not c.passed] == ["no fault"]
    assert any("before 5000 only" in text for text in report.evidence.skipped)
