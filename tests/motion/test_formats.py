"""One contract for every reader: text, npz, .mat and XDF give the same motion for the
same table and options, and what is damaged or hostile is refused by name. C3D, whose
numbers are of 16 or 32 bits and whose times are even, has tests of its own.
"""

import gzip
import random
import struct
import sys

import numpy as np
import pandas as pd
import pytest
import scipy
from hypothesis import given, settings, strategies as st
from laws import STRESS
from refusals import refused
from typer.testing import CliRunner
from written import written

import stimlib
from stimlib.cli import app
from stimlib.errors import BadValue, MissingPackage, RecordingError
from stimlib.motion.recorded import parse_source, recording
from stimlib.motion.table import read_table

N = 200
T = np.arange(N) * 0.01 + 1000.0
TABLE = {
    "t_s": T,
    "x": 0.05 * np.sin(T),
    "y": 0.02 * np.cos(3 * T),
    "us": (np.arange(N) * 10_000.0 + 2**32 - 500_000) % 2**32,
    "trial": 1.0 + (np.arange(N) >= 100),
    "contact": 1.0 * (np.arange(N) % 50 > 3),
}
HOLES = {**TABLE, "x": np.where(np.arange(N) % 20 == 7, np.nan, TABLE["x"])}
SENTINELS = {**TABLE, "x": np.where(np.arange(N) % 20 == 7, -9999.0, TABLE["x"])}


def chunk(tag, content):
    return struct.pack("<BIH", 4, len(content) + 2, tag) + content


def header(number, name, labels, kind="double64", rate=0.0, count=None):
    channels = "".join(f"<channel><label>{n}</label></channel>" for n in labels)
    count = len(labels) if count is None else count
    return chunk(
        2,
        struct.pack("<I", number)
        + f"<info><name>{name}</name><type>Mocap</type><channel_count>{count}</channel_count>"
        f"<channel_format>{kind}</channel_format><nominal_srate>{rate}</nominal_srate>"
        f"<desc><channels>{channels}</channels></desc></info>".encode(),
    )


def samples(number, times, values, stamped=True):
    rows = [
        (struct.pack("<Bd", 8, t) if stamped or not k else b"\0") + np.float64(v).tobytes()
        for k, (t, v) in enumerate(zip(times, values, strict=True))
    ]
    return chunk(3, struct.pack("<IBI", number, 4, len(rows)) + b"".join(rows))


def xdf_of(table, number=1, name="Tracker", rate=0.0, offsets=()):
    names = [n for n in table if n != "t_s"]
    values = np.array([table[n] for n in names]).T
    times, parts = np.asarray(table["t_s"]), [header(number, name, names, rate=rate)]
    for at in range(0, len(times), 60):
        parts.append(samples(number, times[at : at + 60], values[at : at + 60]))
    parts += [chunk(4, struct.pack("<Idd", number, *pair)) for pair in offsets]
    return b"".join(parts)


def xdf(*streams):
    return b"XDF:" + chunk(1, b"<info><version>1.0</version></info>") + b"".join(streams)


def write(path, table):
    """Write a table in the format of the path's name."""
    match path.suffix:
        case ".csv":
            path.write_text(pd.DataFrame(table).to_csv(index=False))
        case ".npz":
            np.savez(path, **table)
        case ".mat":
            others = {"fs": 100.0, "info": {"who": "P01"}, "kind": "press", "emg": np.zeros(5 * N)}
            scipy.io.savemat(path, {**table, **others})
        case ".xdf":
            pytest.importorskip("pyxdf")
            path.write_bytes(xdf(xdf_of(table, 2**24 + 1), header(2, "Marks", ["m"], "string")))
        case ".c3d":
            pytest.importorskip("c3d")
            path.write_bytes(c3d_of(labels=["x"], frames=len(table["x"])))
    return path


OPTIONS = {
    "plain": (TABLE, {"x": "x"}, {"contact": False}),
    "contact, another unit": (TABLE, {"x": "x*1e-3", "y": "y"}, {}),
    "a combination": (TABLE, {"x": "hypot(x, y)"}, {"contact": False, "max_speed": None}),
    "one trial": (TABLE, {"x": "x"}, {"where": {"trial": 2}, "contact": False}),
    "a wrap": (TABLE, {"x": "x"}, {"time": "us*1e-6", "wrap": 2**32, "contact": False}),
    "a second clock": (TABLE, {"x": "x"}, {"clock": "us*1e-6", "wrap": 2**32, "contact": False}),
    "an even rate": (TABLE, {"x": "x"}, {"rate": 100, "contact": False}),
    "interpolated": (HOLES, {"x": "x"}, {"missing": "interpolate", "contact": False}),
    "gaps": (HOLES, {"x": "x"}, {"missing": "gap"}),
    "sentinels": (SENTINELS, {"x": "x"}, {"missing": "hold", "sentinels": (-9999,)}),
}


@pytest.mark.parametrize("form", [".csv", ".npz", ".mat", ".xdf"])
@pytest.mark.parametrize("what", OPTIONS)
def test_every_format_gives_the_same_motion(tmp_path, form, what):
    table, columns, words = OPTIONS[what]
    wanted = recording(table, columns, **words)
    found = recording(write(tmp_path / f"press{form}", table), columns, **words)
    t = np.linspace(-0.1, wanted.duration + 0.1, 3001)
    for name in columns:
        assert np.array_equal(found.motion[name](t), wanted.motion[name](t))
    assert np.array_equal(found.contact(t), wanted.contact(t))
    for key in ("reports", "period", "jumps", "gaps", "start"):
        assert found.info[key] == wanted.info[key], key
    above = 2 if form == ".csv" else 0  # rows of text are lines
    assert found.info["lifts"] == [(row + above, at) for row, at in wanted.info["lifts"]]
    again = parse_source(repr(found), pinned=True)
    assert np.array_equal(again.motion["x"](t), found.motion["x"](t))


@pytest.mark.parametrize("form", [".csv", ".npz", ".mat", ".xdf"])
def test_every_format_refuses_the_same(tmp_path, form):
    table = {**HOLES, "late": np.where(np.arange(N) == 50, 0.0, TABLE["t_s"])}
    path = write(tmp_path / f"press{form}", table)
    for columns, words, why in (
        ({"x": "z"}, {}, "x needs column z, and there is none; the columns are: .*t_s"),
        ({"x": "x"}, {}, "column x: (nan is not finite|.*no number).*missing="),
        ({"y": "y"}, {"time": "late"}, "row"),
        ({"y": "y"}, {"where": {"trial": 7}}, "no row has trial=7; choose from .*1.*2"),
        ({"y": "y"}, {"sha256": "0" * 8}, "SHA-256 is"),
    ):
        refused(BadValue, why, recording, path, columns, **words)


# MATLAB -------------------------------------------------------------------------------
def test_matrices_rows_and_other_lengths_of_a_mat_file(tmp_path):
    path = tmp_path / "m.mat"
    xy = np.array([TABLE["x"], TABLE["y"]]).T
    kinds = {"t_s": T[None], "xy": xy, "n": np.arange(N, dtype=np.int16), "z": xy[:, :1] * 1j}
    others = {"cells": np.array([1, "a"], object), "holes": scipy.sparse.csc_array(xy)}
    scipy.io.savemat(path, {**kinds, "short": xy[1:], **others})
    assert read_table(path).names == ("t_s", "xy_1", "xy_2", "n")
    found = recording(path, {"x": "hypot(xy_1, xy_2)", "n": "n*1e-6"})
    assert found.motion["x"](T - T[0]).tolist() == pytest.approx(np.hypot(*xy.T), abs=1e-15)
    assert "variables skipped: z, cells, holes, short_1 (length 199)" in str(found)
    why = "column short_1: 199 values, and t_s has 200; save one-dimensional"
    refused(RecordingError, why, recording, path, {"x": "xy_1", "y": "short_1"})
    scipy.io.savemat(path, {"x": xy, "x_2": T})
    refused(RecordingError, "column x_2: two columns have this name", read_table, path)
    scipy.io.savemat(path, {"s": {"x": 1.0}})
    refused(RecordingError, "no arrays of real numbers, but s; .*'-struct', 's'", read_table, path)
    for data, why in (
        (b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM", "7.3 is HDF5; .*'-v7'"),
        (b"", "not a MATLAB file of version 5 to 7"),
        (path.read_bytes()[:-9], r"cannot be read as .mat \(the file is cut off\); save vectors"),
        (b"t_s,x\n0,1\n", "not a MATLAB file"),
    ):
        refused(RecordingError, why, read_table, written(path, data))


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", "b1 i1 u1 i2 u2 i4 u4 i8 u8 f4 f8".split())
def test_numbers_of_all_types_are_those_of_scipy(tmp_path, kind, packed):
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (3, 1), (1, 4), (5, 3), (2, 0)):
        values = rng.integers(0, 100, shape).astype(kind)
        path = tmp_path / "m.mat"
        scipy.io.savemat(path, {"v": values, "longer_name": values}, do_compression=packed)
        wanted = scipy.io.loadmat(path)["v"].astype(float)
        table = read_table(path) if values.size else None
        if table is None:
            refused(RecordingError, "no arrays of real numbers", read_table, path)
            continue
        names = [n for n in table.names if n.startswith("v")]
        got = np.concatenate([b.numbers(names) for b in table.batches()], axis=1)
        assert np.array_equal(got, wanted if shape[0] == 1 else wanted.T)


def element(kind, data, order=">"):
    return struct.pack(f"{order}2I", kind, len(data)) + data + bytes(-len(data) % 8)


@pytest.mark.parametrize("name", [b"who", b"when", b"started"])
def test_strings_times_and_tables_of_a_mat_file_are_skipped(tmp_path, name):
    """They have no shape, and numbers of their own in a variable without a name."""
    path = tmp_path / "m.mat"
    scipy.io.savemat(path, {"t_s": T, "x": TABLE["x"]})
    flags = (6, struct.pack("<2I", 17, 0)), (6, struct.pack("<2I", 9, 0))
    own = flags[1], (5, struct.pack("<2i", 1, 4)), (1, b""), (2, b"abcd")
    own = b"".join(element(*part, "<") for part in own)
    parts = flags[0], (1, name), (1, b"MCOS"), (1, b"datetime"), (14, own)
    parts = b"".join(element(*part, "<") for part in parts)
    path.write_bytes(path.read_bytes() + element(14, parts, "<") + element(14, own, "<"))
    found = recording(path, {"x": "x"}, max_speed=None)
    assert found.info["read"] == [f"variables skipped: {name.decode()}"]
    assert len(scipy.io.loadmat(path)["x"][0]) == found.info["reports"] == N


def test_a_mat_file_of_the_other_byte_order(tmp_path):
    values = np.array([[1.5, 2.0, -3.0], [4.0, 5.0, 6.0]])
    parts = (6, struct.pack(">2I", 6, 0)), (5, struct.pack(">2i", 3, 2)), (1, b"x")
    data = b"".join(element(*part) for part in (*parts, (9, values.astype(">f8").tobytes())))
    path = written(tmp_path / "m.mat", b"MATLAB 5.0".ljust(124) + b"\1\0MI" + element(14, data))
    (batch,) = read_table(path).batches()
    assert np.array_equal(batch.numbers(["x_1", "x_2"]), values)
    assert np.array_equal(scipy.io.loadmat(path)["x"], values.T)


def test_a_small_mat_file_of_much_is_refused_without_unpacking(tmp_path, monkeypatch):
    path = tmp_path / "m.mat"
    most = {"x": np.zeros((75, 1000)), "y": np.zeros((75, 1000))}  # more in sum
    scipy.io.savemat(path, most, do_compression=True)
    assert path.stat().st_size < 20_000
    monkeypatch.setattr(stimlib.limits, "recording_bytes", 1e6)
    refused(RecordingError, "unpacked bytes", read_table, path)


def test_the_command_line_takes_such_files(tmp_path):
    path = write(tmp_path / "press.mat", {**TABLE, "contact": np.ones(N)})
    out = tmp_path / "a.wav"
    words = ["render", "squeeze", "--motion", str(path), "--map", "x=x*0.1", "--out", str(out)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "variables skipped: info, kind, fs (length 1)" in str(recording(path, {"x": "x"}))


# XDF ----------------------------------------------------------------------------------
def test_streams_clock_offsets_and_jitter_of_an_xdf_file(tmp_path):
    pytest.importorskip("pyxdf")
    path, rng = tmp_path / "lab.xdf", np.random.default_rng(0)
    jitter = {**TABLE, "t_s": T + rng.normal(0, 1e-3, N)}
    offsets = [(t, 5.0 + 1e-4 * (t - T[0])) for t in np.linspace(T[0], T[-1], 10)]
    pen = {"t_s": T, "x": 2 * TABLE["x"], "tip": TABLE["y"]}
    tracker = xdf_of(jitter, 1, "Tracker", rate=100.0, offsets=offsets)
    path.write_bytes(xdf(tracker, xdf_of(pen, 2, "Pen"), header(3, "Marks", ["m"], "string")))
    found = recording(path, {"x": "'Tracker.x'"}, contact=False)
    assert "stream Tracker: 10 clock offsets applied, times made even" in str(found)
    assert found.info["start"] == pytest.approx(1005.0, abs=1e-3)
    assert found.info["rate"] == pytest.approx(100 / (1 + 1e-4), rel=1e-4)
    for x in ("'Pen.x'", "'2.x'", "tip + 0*x"):
        found = recording(path, {"x": x})
        assert found.info["start"] == T[0] and "0 clock offsets applied)" in str(found)
    for columns in ({"x": "x"}, {"x": "'Pen.x'", "y": "'Tracker.y'"}, {"x": "'Mocap.x'"}):
        why = "in 2 streams of numbers; use those of one, by name, type or number: Tracker.x"
        refused(RecordingError, why, recording, path, columns)
    packed = written(tmp_path / "lab.xdfz", gzip.compress(path.read_bytes()))
    assert recording(packed, {"x": "'Pen.x'"}).info["reports"] == N
    for labels in (["", ""], ["t_s", "x"]):
        path.write_bytes(xdf(header(1, "Pen", labels), samples(1, T, np.zeros((N, 2)))))
        assert read_table(path).names[:3] == ("t_s", "channel1", "channel2")


def test_rows_that_an_xdf_stream_lost_are_no_jitter(tmp_path):
    """pyxdf spreads the others over a silence, unless it is as long as 500 of them."""
    pytest.importorskip("pyxdf")
    path, k = tmp_path / "lab.xdf", np.arange(N)
    lost = {**TABLE, "t_s": T + 0.5 * (k >= 100)}
    path.write_bytes(xdf(xdf_of(lost, rate=100.0)))
    refused(RecordingError, "row 100: a gap of 0.51 s", recording, path, {"x": "x"}, contact=False)
    found = recording(path, {"x": "x"}, contact=False, max_gap=1.0).motion["x"]
    assert found(lost["t_s"] - T[0]) == pytest.approx(TABLE["x"], abs=1e-9)
    path.write_bytes(xdf(xdf_of({**TABLE, "t_s": T - 9.0 * (k >= 100)}, rate=100.0)))
    refused(RecordingError, "row 100: time goes back", recording, path, {"x": "x"}, contact=False)
    late = np.where((k >= 100) & (k < 130), T[130] + 1e-5 * (k - 130), T)
    packets = T[k // 15 * 15] + 0.15 + 1e-5 * (k % 15)
    for stamps in (late, packets):  # what a program sent late was not lost
        path.write_bytes(xdf(xdf_of({**TABLE, "t_s": stamps}, rate=100.0)))
        found = recording(path, {"x": "x"}, contact=False)
        assert np.ptp(np.diff(found.motion["x"]._knots)) < 1e-12
        assert found.info["rate"] == pytest.approx(100, rel=0.01) and "made even" in str(found)


@pytest.mark.parametrize(
    ("form", "kind"),
    [("double64", "f8"), ("float32", "f4"), ("int64", "i8")]
    + [("int32", "i4"), ("int16", "i2"), ("int8", "i1")],
)
def test_numbers_of_all_types_of_an_xdf_file(tmp_path, form, kind):
    pytest.importorskip("pyxdf")
    values = (np.arange(2 * N).reshape(N, 2) % 100).astype(kind)
    for stamp in (lambda t: struct.pack("<Bd", 8, t), lambda t: b"\0"):
        rows = b"".join(stamp(t) + v.tobytes() for t, v in zip(T, values, strict=True))
        part = chunk(3, struct.pack("<IBI", 1, 4, N) + rows)
        (batch,) = read_table(
            written(tmp_path / "a.xdf", xdf(header(1, "A", ["x", "y"], form, rate=100.0), part))
        ).batches()
        assert np.array_equal(batch.numbers(["x", "y"]), values.T)


def test_samples_that_pyxdf_leaves_out(tmp_path, monkeypatch):
    """Those beyond the number in the footer are none; others would be missed."""
    pyxdf = pytest.importorskip("pyxdf")
    honest, path = pyxdf.load_xdf, tmp_path / "a.xdf"

    def shorter(*given, **words):
        streams, head = honest(*given, **words)
        for s in streams:
            s |= {key: s[key][:190] for key in ("time_stamps", "time_series")}
        return streams, head

    monkeypatch.setattr(pyxdf, "load_xdf", shorter)
    for count in (190, 200):
        footer = f"<info><sample_count>{count}</sample_count></info>".encode()
        path.write_bytes(xdf(xdf_of(TABLE), chunk(6, struct.pack("<I", 1) + footer)))
        if count == 190:
            assert recording(path, {"x": "x"}).info["reports"] == 190
        else:
            refused(RecordingError, "pyxdf reads 190 of 200", recording, path, {"x": "x"})


def test_without_pyxdf_the_error_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyxdf", None)
    refused(
        MissingPackage,
        "an XDF file needs the package pyxdf",
        read_table,
        written(tmp_path / "a.xdf", xdf()),
    )


HUGE = struct.pack("<IBQ", 1, 8, 2**40) + b"\0" * 8
BAD_XDF = {
    "no XDF": (b"t_s,x\n0,1\n", "cannot be read as XDF"),
    "empty": (b"", "cannot be read as XDF"),
    "no streams": (xdf(), "in 0 streams"),
    "texts only": (xdf(header(1, "M", ["m"], "string")), "in 0 streams"),
    "huge count": (xdf(header(1, "A", ["x"]), chunk(3, HUGE)), "1099511627776 samples in a chunk"),
    "many channels": (xdf(header(1, "A", [], count=10**9), samples(1, T, T)), "channels"),
    "cut off": (xdf(xdf_of(TABLE))[:-3], "cut off or damaged; copy it again, or load it with"),
    "a number of 3 bytes": (xdf() + b"\3\0\0\0", "a number of 3 bytes"),
    "no XML": (xdf(chunk(2, b"\1\0\0\0<info>"), samples(1, T, T)), "cannot be read as XDF"),
    "entities": (
        xdf(
            chunk(
                2,
                b'\1\0\0\0<!DOCTYPE a [<!ENTITY b "'
                + b"b" * 10**5
                + b'">]><info><name>'
                + b"&b;" * 10**5
                + b"</name></info>",
            )
        ),
        "cannot be read as XDF",
    ),
}


# C3D ----------------------------------------------------------------------------------
RATE, STEP = 100.0, 10  # Hz; samples of a channel in a frame
TIP = np.round(500 * np.stack([np.sin(T), np.cos(T), T / 1e4], axis=1))  # mm
PLATE = np.round(50 * np.sin(np.arange(2 * N * STEP) / 70)).reshape(N, STEP, 2)  # counts
HIDDEN = np.arange(N) % 50 == 20
LABELS = ("P1:Tip", "", "P1:Tip")


def c3d_of(
    order="<",
    integer=False,
    count=None,
    labels=LABELS,
    channels=("Fz", "P1:Tip.X"),
    frames=N,
    start=None,
    **lies,
):
    """Return a file by the format's description: header, parameters, frames."""
    scale = 0.5 if integer else -0.5
    each = STEP if channels else 0

    def parameter(group, name, kind, shape, content):
        content = struct.pack("<bB", kind, len(shape)) + bytes(shape) + content + b"\0"
        return (
            struct.pack("<bb", len(name), group)
            + name.encode()
            + struct.pack(f"{order}h", len(content) + 2)
            + content
        )

    def group(number, name):
        head = struct.pack("<bb", len(name), -number) + name.encode()
        return head + struct.pack(f"{order}h", 3) + b"\0"

    def number(n, name, form, *values):
        shape = (len(values),) if len(values) > 1 else ()
        size = 4 if form == "f" else 2
        return parameter(n, name, size, shape, struct.pack(f"{order}{len(values)}{form}", *values))

    def texts(n, name, given):
        return parameter(
            n, name, -1, (12, len(given)), b"".join(t.encode().ljust(12) for t in given)
        )

    facts = {"points": len(labels), "analogs": len(channels), "rate": RATE} | lies
    count = frames if count is None else count
    parts = group(1, "POINT") + number(1, "USED", "h", facts["points"])
    parts += number(1, "SCALE", "f", scale) + number(1, "RATE", "f", facts["rate"])
    for at in range(0, max(len(labels), 1), 255):
        parts += texts(1, f"LABELS{at // 255 + 1 if at else ''}", labels[at : at + 255])
    parts += texts(1, "UNITS", ["mm"])
    parts += group(2, "ANALOG") + number(2, "USED", "h", facts["analogs"])
    parts += number(2, "RATE", "f", facts["rate"] * each) + number(2, "GEN_SCALE", "f", 0.25)
    if channels:
        parts += number(2, "SCALE", "f", 2.0, 4.0) + number(2, "OFFSET", "h", 3, -5)
        parts += texts(2, "LABELS", channels) + texts(2, "UNITS", ["N", "Nm"])
    if start:
        parts += group(3, "TRIAL")
        for name, at in (("START", start), ("END", start + frames - 1)):
            parts += number(3, f"ACTUAL_{name}_FIELD", "H", *divmod(at, 1 << 16)[::-1])
    blocks = -(-(len(parts) + 4) // 512)
    parts = struct.pack("<BBBB", 1, 80, blocks, 84 if order == "<" else 86) + parts
    head = struct.pack("<BB", 2, 80)
    head += struct.pack(f"{order}5H", len(labels), len(channels) * each, 7, count + 6, 10)
    head += struct.pack(f"{order}fHHf", scale, blocks + 2, each, RATE)
    rows = []
    for k in range(frames):
        for point in range(len(labels)):
            xyz = TIP[k] + point if not integer else (TIP[k] + point) / scale
            last = -1 if HIDDEN[k] else 3
            rows.append(
                struct.pack(
                    f"{order}4{'h' if integer else 'f'}", *map(int if integer else float, xyz), last
                )
            )
        if channels:
            rows.append(PLATE[k].astype(f"{order}{'i2' if integer else 'f4'}").tobytes())
    return head.ljust(512, b"\0") + parts.ljust(512 * blocks, b"\0") + b"".join(rows)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("integer", [False, True])
def test_points_and_channels_of_a_c3d_file(tmp_path, order, integer):
    pytest.importorskip("c3d")
    path = written(tmp_path / "hand.c3d", c3d_of(order, integer))
    names = [f"{n}.{axis}" for n in ("P1:Tip", "point2", "point3") for axis in "XYZ"]
    assert read_table(path).names == ("t_s", *names, "Fz", "channel2")
    table = {"t_s": np.arange(N) / RATE, "x": np.where(HIDDEN, np.nan, TIP[:, 0])}
    table |= {"y": np.where(HIDDEN, np.nan, TIP[:, 1] + 2)}
    words = {"missing": "interpolate"}
    columns = {"x": "'P1:Tip.X'*1e-3", "y": "'point3.Y'*1e-3"}
    found = recording(path, columns, **words)
    wanted = recording(table, {"x": "x*1e-3", "y": "y*1e-3"}, **words)
    t = np.linspace(0, wanted.duration, 3001)
    for name in columns:
        assert np.array_equal(found.motion[name](t), wanted.motion[name](t))
    assert found.info["read"][:2] == [
        "3 points in mm, 200 frames at 100 Hz",
        "2 channels in N, Nm at 1000 Hz",
    ]
    refused(RecordingError, "(nan is not finite|no number).*missing=", recording, path, columns)
    # a channel has a row for each of its samples, and a point one in ten
    force = (PLATE.reshape(-1, 2) - (3, -5)) * (0.5, 1.0)
    both = {"x": "'P1:Tip.X'*1e-3", "f": "Fz", "g": "channel2"}
    found = recording(path, both, max_speed=None, **words)
    at = np.arange(N * STEP) / (RATE * STEP)
    assert np.array_equal(found.motion["f"](at), force[:, 0])
    assert np.array_equal(found.motion["g"](at), force[:, 1])
    assert np.array_equal(found.motion["x"](at[::STEP][~HIDDEN]), TIP[~HIDDEN, 0] * 1e-3)


def test_frames_that_a_c3d_file_does_not_state_are_noted(tmp_path):
    """As of more than the 65535 that its header can state."""
    pytest.importorskip("c3d")
    path = written(tmp_path / "a.c3d", c3d_of(count=N - 50))
    for wanted in (True, False):
        found = recording(path, {"f": "Fz"}, max_speed=None)
        assert any("goes on after the last frame" in note for note in found.info["read"]) == wanted
        path.write_bytes(c3d_of())


@pytest.mark.parametrize("start", [7, 65_535, 65_536, 70_000, 200_000])
@pytest.mark.parametrize("behind", [0, 100])
def test_a_part_of_a_long_trial_in_a_c3d_file(tmp_path, start, behind):
    """Its last block is filled up with zeros, which are no frame."""
    pytest.importorskip("c3d")
    path = written(tmp_path / "a.c3d", c3d_of(start=start, channels=()) + bytes(behind))
    found = recording(path, {"x": "'P1:Tip.X'*1e-3"}, missing="hold")
    assert found.info["reports"] == N and found.info["jumps"] == []
    assert found.motion["x"](found.duration) == TIP[-1, 0] * 1e-3


def test_c3d_files_of_points_or_channels_alone(tmp_path):
    pytest.importorskip("c3d")
    path = written(tmp_path / "a.c3d", c3d_of(labels=()))
    found = recording(path, {"f": "Fz"}, max_speed=None)
    assert found.info["reports"] == N * STEP and "0 points" in str(found)
    path.write_bytes(c3d_of(channels=("t_s", "Fz")))
    assert read_table(path).names[-2:] == ("channel1", "Fz")
    path.write_bytes(c3d_of(channels=()))
    assert read_table(path).names[-1] == "point3.Z" and len(read_table(path).read) == 1
    path.write_bytes(c3d_of(labels=[f"M{k}" for k in range(300)], frames=2))
    assert read_table(path).names[-5:-2] == ("M299.X", "M299.Y", "M299.Z")


BAD_C3D = {
    "no C3D": (b"t_s,x\n0,1\n", "cannot be read as C3D"),
    "empty": (b"", "cannot be read as C3D .*; export it anew"),
    "cut off": (c3d_of()[:-1], "199 of 200 frames"),
    "more frames than there are": (c3d_of(count=60_000), "200 of 60000 frames"),
    "no frames": (c3d_of(count=0), "0 of 0 frames"),
    "other points": (c3d_of(points=4), "inconsistent point count"),
    "other channels": (c3d_of(analogs=1), "inconsistent analog count"),
    "another rate": (c3d_of(rate=0.0), "inconsistent frame rate"),
}


ODD = [("xdf", "pyxdf", "x", *bad) for bad in BAD_XDF.values()]
ODD += [("c3d", "c3d", "'P1:Tip.X'", *bad) for bad in BAD_C3D.values()]


@pytest.mark.parametrize(("form", "package", "x", "data", "why"), ODD, ids=[*BAD_XDF, *BAD_C3D])
def test_odd_files(tmp_path, form, package, x, data, why):
    pytest.importorskip(package)
    refused(RecordingError, why, recording, written(tmp_path / f"a.{form}", data), {"x": x})


def test_many_rows_and_columns_of_a_c3d_file_are_refused(tmp_path, monkeypatch):
    pytest.importorskip("c3d")
    path = written(tmp_path / "a.c3d", c3d_of())
    for limit, most, columns in (
        ("recording_columns", 10, {"x": "'P1:Tip.X'"}),
        ("recording_rows", N - 1, {"x": "'P1:Tip.X'"}),
        ("recording_rows", N * STEP - 1, {"f": "Fz"}),
    ):
        with monkeypatch.context() as m:
            m.setattr(stimlib.limits, limit, most)
            refused(RecordingError, limit, recording, path, columns)


# -- all of them


@pytest.mark.parametrize("form", [".mat", ".xdf", ".c3d"])
@settings(max_examples=2000 if STRESS else 60)
@given(seed=st.integers(0, 2**32))
def test_damaged_files_are_read_or_refused_by_name(tmp_path_factory, form, seed):
    folder, rng = tmp_path_factory.mktemp("bad"), random.Random(seed)
    path = write(folder / f"a{form}", {name: values[:20] for name, values in TABLE.items()})
    data = bytearray(path.read_bytes())
    for _ in range(rng.randrange(3)):
        data[rng.randrange(len(data))] = rng.choice([0, 1, 4, 8, 127, 255, rng.randrange(256)])
    path.write_bytes(data[: rng.choice([len(data), rng.randrange(len(data))])])
    try:
        column = "x.X" if form == ".c3d" else "x"
        recording(path, {"x": column}, contact=False, max_speed=None)
    except BadValue:
        pass
