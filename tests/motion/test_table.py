"""Tables of others: numpy's reader and the exact one see the same, limits hold before
memory is taken, and files of Excel.
"""

import io
import os
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from laws import STRESS
from refusals import refused

import stimlib
from stimlib.errors import RecordingError
from stimlib.motion import table as tables
from stimlib.motion.recorded import recording
from stimlib.motion.table import read_table


def unread(says, *given, **how):
    """The error where no recording is read from this, and ``says`` is why."""
    return refused(RecordingError, says, recording, *given, **how)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


@pytest.fixture
def limits():
    """stimlib.limits, as they were afterwards."""
    before = {
        name: getattr(stimlib.limits, name)
        for name in ("recording_bytes", "recording_rows", "recording_columns")
    }
    yield stimlib.limits
    for name, value in before.items():
        setattr(stimlib.limits, name, value)


def rows_of(path, columns):
    """Row numbers and cells, by whichever reader."""
    table = read_table(path)
    batches = list(table.batches())
    rows = np.concatenate([b.rows for b in batches]).tolist()
    assert len(rows) <= table.most
    return (
        type(batches[0]).__name__,
        rows,
        np.concatenate([b.numbers(columns) for b in batches], axis=1),
    )


# -- two readers, one table


@settings(max_examples=40)
@given(data=st.data())
def test_a_quote_anywhere_changes_nothing(tmp_path_factory, data):
    """The fast reader takes what is plain, the exact one the rest from there on;
    numbers and row numbers are the same.
    """
    path = tmp_path_factory.getbasetemp() / "either.csv"
    words = [
        "0",
        "1.5",
        "-2e-3",
        " 7 ",
        "+.5",
        "1e400",
        "nan",
        "0.1000000000000000055511151231257827",
        "5e-324",
        "-0",
    ]
    rows = data.draw(
        st.lists(st.lists(st.sampled_from(words), min_size=2, max_size=2), min_size=1, max_size=30)
    )
    end = data.draw(st.sampled_from(["\n", "\r\n"]))
    text = "a,b,c" + end + "".join(f"{a},{b},kind{end}" for a, b in rows)
    path.write_bytes(text.encode())
    kind, numbers, values = rows_of(path, ["b", "a"])
    assert kind == "_Plain"
    path.write_bytes(text.replace("kind", '"kind"').encode())
    other, exact_numbers, exact = rows_of(path, ["b", "a"])
    assert other == "_Exact" and numbers == exact_numbers == list(range(2, len(rows) + 2))
    assert np.array_equal(values, exact, equal_nan=True) and np.array_equal(
        np.signbit(values), np.signbit(exact)
    )


def test_pieces_and_batches_do_not_show(path, monkeypatch):
    t = np.arange(500) * 0.01
    lines = [f"{v:.2f},{np.sin(v) * 1e-3:.6f},{i % 7}\n" for i, v in enumerate(t)]
    path.write_text("t_s,x,kind\n" + "".join(lines))
    whole = recording(path, {"x": "x"})
    monkeypatch.setattr(tables, "PIECE", 100)
    monkeypatch.setattr(tables, "BATCH", 7)
    at = np.linspace(-1, 6, 1001)
    assert np.array_equal(recording(path, {"x": "x"}).motion["x"](at), whole.motion["x"](at))
    # quoted from here on
    lines[300] = lines[300].replace("\n", '"\n', 1).replace(",", ',"', 2).replace('"', "", 1)
    path.write_text("t_s,x,kind\n" + "".join(lines))
    assert np.array_equal(recording(path, {"x": "x"}).motion["x"](at), whole.motion["x"](at))
    some = recording(path, {"x": "x"}, where={"kind": 6})
    assert some.info["reports"] == 71 and some.motion["x"](0.0) == pytest.approx(
        np.sin(0.06) * 1e-3, abs=1e-6
    )
    for wrong, message in (
        (",,6\n", "row 403, column x: there is no number"),
        (",6\n", "row 403, column kind: 2 fields for 3"),
    ):
        path.write_text(
            "t_s,x,kind\n" + "".join(lines[:401]) + "4.01" + wrong + "".join(lines[402:])
        )
        unread(message, path, {"x": "x"})


def test_decimal_commas_of_a_spreadsheet(path):
    path.write_bytes(
        "\ufefft_s;x (mm);note\r\n0,00;1,5;a,b\r\n0,01;-2,5E-1;\r\n0,02;3;c\r\n".encode()
    )
    r = recording(path, {"x": "'x (mm)'*1e-3"}, max_speed=None)
    assert r.motion["x"]([0.0, 0.01, 0.02]).tolist() == [0.0015, -0.00025, 0.003]
    # the row that has this number
    unread("one report is not a motion", path, {"x": "'x (mm)'*1e-3"}, where={"x (mm)": "1,50"})
    path.write_text("t_s;x\n0,00;1.234,5\n0,01;2\n")
    unread("row 2, column x: '1.234,5' is not a number", path, {"x": "x"})
    path.write_text("t_s,x\n0,00,1,5\n0,01,2,5\n")
    unread("row 2: 4 fields for 2 columns.*decimals with a point.*semicolons", path, {"x": "x"})


@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "above",
    [["sep=;"], ["# by hand, on Monday", "#"], ['\ufeff"SEP=;"', "# a;b", '#"'], ["#1;2;3"]],
)
def test_a_hint_of_excel_and_comments_stand_above_the_names(path, above, end, quote):
    lines = [*above, "t_s;x", "0,00;1", f"{quote}0,01{quote};2"]
    path.write_bytes(end.join(lines).encode())
    assert recording(path, {"x": "x*1e-3"}).motion["x"]([0.0, 0.01]).tolist() == [0.001, 0.002]
    path.write_bytes(end.join([*lines, "0,02;c"]).encode())
    unread(f"row {len(lines) + 1}, column x: 'c' is not a number", path, {"x": "x"})


def test_what_a_hint_says_goes_before_what_the_names_look_like(path):
    for mark in ",;|\t":
        other = ";" if mark == "," else ","
        path.write_text(f"sep={mark}\nt_s{mark}x{other}y\n0{mark}1\n1{mark}2\n")
        assert read_table(path).names == ("t_s", f"x{other}y") and rows_of(path, ["t_s"])[
            2
        ].tolist() == [[0.0, 1.0]]


@pytest.mark.parametrize(
    ("names", "row"),
    [("#,t_s,x", "1,0,0"), ("# t_s,x", "0,0"), ("#;x", "1;0,5"), ('#,"x"', '"0",0')],
)
def test_names_may_begin_with_a_number_sign(path, names, row):
    path.write_text(f"# by hand\n{names}\n{row}\n")
    assert read_table(path).names == tuple(names.replace('"', "").replace(";", ",").split(","))


@pytest.mark.parametrize("text", ["sep=;\n", "# a\n", "sep=,\r\n#\r\n# t_s,x"])
def test_nothing_but_hint_and_comments(path, text):
    path.write_text(text)
    refused(
        RecordingError,
        "the file is empty; give a file with a line of column names",
        read_table,
        path,
    )


# -- limits


def zipped(path, *members, packing=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", packing) as z:
        for name, data in members:
            z.writestr(name, data)
    return path


def array(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text + data


def saved(**arrays) -> bytes:
    raw = io.BytesIO()
    np.savez(raw, **arrays)
    return raw.getvalue()


def test_limits_of_a_table(path, limits):
    path.write_text(",".join(f"c{i}" for i in range(100_000)) + "\n")
    unread(
        "columns: 100000 is more than limits.recording_columns = 1000; .*STIMLIB_LIMITS",
        path,
        {"x": "x"},
    )
    path.write_text("t_s,x\n" + "0,0\n" * 30)
    limits.recording_rows = 20
    unread("rows: 3. is more than limits.recording_rows = 20", path, {"x": "x"})
    limits.recording_bytes = 100
    unread("bytes: 126 is more than limits.recording_bytes = 100", path, {"x": "x"})


def test_a_line_without_an_end(path, limits):
    limits.recording_columns = 10
    path.write_text("t_s,x\n0," + ('"' + "1" * 100_000) * 5)
    unread("row 2: not CSV", path, {"x": "x"})
    path.write_text("a," * 200_000)
    unread("columns: 5121 is more than", path, {"x": "x"})


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_what_is_no_regular_file_is_not_waited_for(tmp_path, suffix):
    pipe = tmp_path / f"log.{suffix}"
    os.mkfifo(pipe)
    zero = tmp_path / f"zero.{suffix}"
    zero.symlink_to("/dev/zero")
    for place in (pipe, zero):
        unread(
            r"cannot be read \(it is not a regular file\); give the name of a CSV or npz",
            place,
            {"x": "x"},
        )


def test_a_small_archive_of_much_is_refused_without_unpacking(tmp_path):
    """64 MiB of zeros in 65 kB: the memory of a process that is told no more than its
    own.
    """
    head = array("{'descr': '|u1', 'fortran_order': False, 'shape': (67108864,), }")
    with (
        zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as z,
        z.open("x.npy", "w") as f,
    ):
        f.write(head)
        for _ in range(64):
            f.write(bytes(1 << 20))
    said = peak(tmp_path / "bomb.npz")
    assert "67108864" not in said[0] and "recording_rows" in said[0] and said[1] < 40


def peak(path, columns="{'x': 'x'}"):
    """What `recording` says in a process of its own, and by how many MiB that grows."""
    code = f"""if True:
        import resource
        from stimlib.motion.recorded import recording
        from stimlib.errors import RecordingError
        memory = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        before = memory()
        try:
            print(recording({str(path)!r}, {columns}))
        except RecordingError as error:
            print(error)
        print(memory() - before)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *said, grown = done.stdout.splitlines()
    return "\n".join(said), float(grown)


@pytest.mark.longer
def test_memory_of_many_rows(path):
    """10 million rows within 1 GB is 100 bytes a row, for file, time, position and
    cubics; it was 430.
    """
    rows = 10_000_000 if STRESS else 300_000
    with path.open("w") as f:
        f.write("t_s,x,contact\n")
        for a in range(0, rows, 100_000):
            f.write(
                "".join(f"{i / 1000:.3f},{i % 999 * 1e-6:.8f},1\n" for i in range(a, a + 100_000))
            )
    said, grown = peak(path)
    assert f"{rows} reports" in said
    assert grown < 100 * rows / 2**20 + 10


@pytest.mark.parametrize(
    "members, message",
    [
        (
            [
                (
                    "x.npy",
                    array("{'descr': '<f8', 'fortran_order': False, 'shape': (8589934592,), }"),
                )
            ],
            "recording_rows",
        ),
        (
            [
                (
                    "x.npy",
                    array("{'descr': '<f8', 'fortran_order': False, 'shape': (5,), }", bytes(24)),
                )
            ],
            "24 bytes for 5 values of 8",
        ),
        (
            [("x.npy", array("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }"))],
            "cannot be read as npz",
        ),
        (
            [
                (
                    "x.npy",
                    array("{'descr': '<U4000000000', 'fortran_order': False, 'shape': (1,), }"),
                )
            ],
            "not an array",
        ),
        (
            [
                (
                    "x.npy",
                    array("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1,), }"),
                )
            ],
            "not an array",
        ),
        (
            [("x.npy", array("{'descr': '<f7', 'fortran_order': False, 'shape': (1,), }"))],
            "cannot be read as npz",
        ),
        ([("x.npy", array("(" * 99))], "cannot be read as npz"),
        ([("x.npy", b"\x93NUMPY\2\0\xff\xff\xff\xff")], "its header is too long"),
        (
            [("x.npy", b"\x93NUMPY\1\0" + (10_001).to_bytes(2, "little") + bytes(99))],
            "its header is too long",
        ),
        (
            [("x.npy", b"\x93NUMPY\1\0" + (10_000).to_bytes(2, "little") + b"[0]".ljust(10_000))],
            "list indices",
        ),
        ([("x.npy", b"\x93NUMPY\1\0\xff")], "cannot be read as npz"),
        (
            [(f"a{i}.npy", b"") for i in range(3000)],
            "arrays: 3000 is more than limits.recording_columns = 1000",
        ),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_odd_archives(tmp_path, members, message):
    unread(message, zipped(tmp_path / "log.npz", *members), {"x": "x"})


@pytest.mark.parametrize("packing", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_packings_that_numpy_does_not_write(tmp_path, packing):
    """One of them asks for a dictionary of up to 4 GiB."""
    good = array("{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }", bytes(24))
    unread(
        "packed in another way than numpy does",
        zipped(tmp_path / "log.npz", ("x.npy", good), packing=packing),
        {"x": "x"},
    )


def test_an_archive_that_is_locked_or_lies(tmp_path):
    path, t = tmp_path / "log.npz", np.arange(4) * 0.01
    good = saved(t_s=t, x=t)
    at = good.index(b"PK\1\2")
    for change, message in (
        (good[: at + 8] + b"\1\0" + good[at + 10 :], "another way"),
        (good[: at + 24] + (130).to_bytes(4, "little") + good[at + 28 :], "cannot be read as npz"),
        (good.replace(t.tobytes(), t[::-1].tobytes(), 1), "cannot be read as npz .*CRC"),
    ):
        path.write_bytes(change)
        unread(message, path, {"x": "x"})
    path.write_bytes(
        saved(t_s=t, x=t, note=np.array(["a"] * 4)).replace(b"a\0\0\0", b"\xff\xff\xff\x7f", 1)
    )
    unread("column note: cannot be read as npz", path, {"x": "x"}, where={"note": "a"})


def test_only_the_columns_in_use_are_unpacked(tmp_path):
    """Damage far inside another array does not matter; damage in one that is used
    does.
    """
    t = np.arange(4000) * 0.01
    path = tmp_path / "log.npz"
    path.write_bytes(
        saved(t_s=t, x=t, other=t + 5).replace((t + 5).tobytes(), (t + 6).tobytes(), 1)
    )
    assert recording(path, {"x": "x"}, max_speed=None).info["reports"] == 4000
    unread("column other: cannot be read as npz", path, {"x": "other"})


def test_a_name_with_an_escape_is_shown_as_a_code(tmp_path):
    path = tmp_path / "a\x1b[31m.csv"
    path.write_text("t_s,x\x1b[2J\n0,0\n0.01,0\n")
    error = unread(None, path, {"x": "x"})
    r = recording(path, {"x": "'x\x1b[2J'"})
    for text in (str(error), str(r), repr(r), repr(r.motion["x"])):
        assert "\x1b" not in text and "\\x1b" in text
