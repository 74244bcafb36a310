"""Tables of others: numpy's reader and the exact one see the same, limits hold before
memory is taken, and files of Excel.
"""

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from laws import STRESS
from memory import most_memory
from refusals import refused
from written import written

import stimlib
from stimlib.errors import RecordingError
from stimlib.motion import recording, table as tables
from stimlib.motion.table import read_table


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


def rows_of(path, columns):
    """Which reader it was, the row numbers and the cells."""
    table = read_table(path)
    batches = list(table.batches())
    rows = np.concatenate([b.rows for b in batches]).tolist()
    cells = np.concatenate([b.numbers(columns) for b in batches], axis=1)
    assert len(rows) <= table.most
    return type(batches[0]).__name__, rows, cells


# -- two readers, one table


WORDS = "0,1.5,-2e-3, 7 ,+.5,1e400,nan,0.1000000000000000055511151231257827,5e-324,-0".split(",")


@settings(max_examples=60)
@given(
    rows=st.lists(st.tuples(*[st.sampled_from(WORDS)] * 2), min_size=1, max_size=30),
    end=st.sampled_from(["\n", "\r\n"]),
    large=st.sampled_from([tables.LARGE, 0]),
)
def test_a_quote_anywhere_changes_nothing(tmp_path_factory, rows, end, large):
    """The fast reader takes what is plain, the exact one the rest from there on;
    numbers and row numbers are the same.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "LARGE", large)
        compare_readers(tmp_path_factory, rows, end)


def compare_readers(tmp_path_factory, rows, end):
    path = tmp_path_factory.getbasetemp() / "either.csv"
    text = "a,b,c" + end + "".join(f"{a},{b},kind{end}" for a, b in rows)
    kind, numbers, values = rows_of(written(path, text), ["b", "a"])
    other, exact_numbers, exact = rows_of(
        written(path, text.replace("kind", '"kind"').encode()), ["b", "a"]
    )
    assert (kind, other) == ("_Plain", "_Exact")
    assert numbers == exact_numbers == list(range(2, len(rows) + 2))
    assert np.array_equal(values, exact, equal_nan=True)
    assert np.array_equal(np.signbit(values), np.signbit(exact))


def test_pieces_and_batches_do_not_show(path, monkeypatch):
    t, at = np.arange(500) * 0.01, np.linspace(-1, 6, 1001)
    lines = [f"{v:.2f},{np.sin(v) * 1e-3:.6f},{i % 7}\n" for i, v in enumerate(t)]
    quotes = '"' + lines[300].replace(",", '","').replace("\n", '"\n')
    quoted = [*lines[:300], quotes, *lines[301:]]
    whole = recording(written(path, "t_s,x,kind\n" + "".join(lines)), {"x": "x"}).motion["x"](at)
    monkeypatch.setattr(tables, "PIECE", 100)
    monkeypatch.setattr(tables, "BATCH", 7)
    for rows in (lines, quoted):
        path.write_text("t_s,x,kind\n" + "".join(rows))
        assert np.array_equal(recording(path, {"x": "x"}).motion["x"](at), whole)
    some = recording(path, {"x": "x"}, where={"kind": 6})
    assert some.info["reports"] == 71
    assert some.motion["x"](0.0) == pytest.approx(np.sin(0.06) * 1e-3, abs=1e-6)
    for wrong, says in ((",,6\n", "row 403, column x: "), (",6\n", "row 403, column kind: 2 f")):
        path.write_text("t_s,x,kind\n" + "".join(quoted[:401]) + "4.01" + wrong + lines[402])
        refused(RecordingError, says, recording, path, {"x": "x"})


def test_decimal_commas_of_a_spreadsheet(path):
    path.write_bytes(
        "\ufefft_s;x (mm);note\r\n0,00;1,5;a,b\r\n0,01;-2,5E-1;\r\n0,02;3;c\r\n".encode()
    )
    r = recording(path, {"x": "'x (mm)'*1e-3"}, max_speed=None)
    assert r.motion["x"]([0.0, 0.01, 0.02]).tolist() == [0.0015, -0.00025, 0.003]
    assert r.info["read"] == ["decimal commas"]
    where = {"x (mm)": "1,50"}  # the row that has this number
    refused(RecordingError, "one report", recording, path, {"x": "'x (mm)'"}, where=where)
    # no thousand begins with 0, and none has a comma between semicolons
    for text in ("t_s\tx\n0,000\t0,125\n0,010\t0,500\n", 't_s;x\n0,000;"1,125"\n0,010;2,500\n'):
        found = recording(written(path, text), {"x": "x"}, max_speed=None).motion["x"]
        assert found([0.0, 0.01]) % 1.0 == pytest.approx([0.125, 0.5])


@pytest.mark.parametrize(
    ("above", "end", "quote"),
    [
        (["sep=;"], "\n", ""),
        (["sep=;"], "\r\n", '"'),
        (["# by hand, on Monday", "#"], "\r\n", ""),
        (["# by hand, on Monday", "#"], "\r", '"'),
        (['\ufeff"SEP=;"', "# a;b", '#"'], "\r", ""),
        (['\ufeff"SEP=;"', "# a;b", '#"'], "\n", '"'),
        (["#1;2;3"], "\n", ""),
        (["#1;2;3"], "\r", '"'),
    ],
)
def test_a_hint_of_excel_and_comments_stand_above_the_names(path, above, end, quote):
    lines = [*above, "t_s;x", "0,00;1", f"{quote}0,01{quote};2"]
    assert recording(written(path, end.join(lines)), {"x": "x*1e-3"}).motion["x"](
        [0.0, 0.01]
    ).tolist() == [0.001, 0.002]
    refused(
        RecordingError,
        f"row {len(lines) + 1}, column x: 'c'",
        recording,
        written(path, end.join([*lines, "0,02;c"])),
        {"x": "x"},
    )


@pytest.mark.parametrize(
    ("text", "names"),
    [
        *(
            (f"sep={m}\nt_s{m}x{o}y\n0{m}1\n", ("t_s", f"x{o}y"))
            for m, o in (",;", ";,", "|,", "\t,")
        ),
        ("# by hand\n#,t_s,x\n1,0,0\n", ("#", "t_s", "x")),
        ("# by hand\n# t_s,x\n0,0\n", ("t_s", "x")),
        ("# by hand\n#;x\n1;0,5\n", ("#", "x")),
        ('# by hand\n#,"x"\n"0",0\n', ("#", "x")),
    ],
)
def test_names_after_a_hint_or_with_a_number_sign(path, text, names):
    assert read_table(written(path, text)).names == names


# -- limits


def zipped(path, *members, packing=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", packing) as z:
        for name, data in members:
            z.writestr(name, data)
    return path


def array(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text + data


def described(shape, descr="'<f8'", data=b""):
    """An array of an npz whose header says so."""
    return array(f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}", data)


def saved(**arrays) -> bytes:
    raw = io.BytesIO()
    np.savez(raw, **arrays)
    return raw.getvalue()


@pytest.mark.parametrize(
    ("limit", "most", "text", "says"),
    [
        ("columns", 1000, ",".join(f"c{i}" for i in range(100_000)) + "\n", "columns: 100000"),
        ("columns", 10, "a," * 200_000, "row 1: not CSV"),
        ("columns", 10, "t_s,x\n0," + ('"' + "1" * 100_000) * 5, "row 2: not CSV"),
        ("rows", 20, "t_s,x\n" + "0,0\n" * 30, "rows: 3. .*recording_rows = 20"),
        ("bytes", 100, "t_s,x\n" + "0,0\n" * 30, "bytes: 126 .*recording_bytes = 100"),
        *(
            ("rows", 20, text, "file is empty")
            for text in ("sep=;\n", "# a\n", "sep=,\r\n#\r\n# a,b")
        ),
        ("rows", 20, "t_s;x\n0,00;1.234,5\n0,01;2\n", "row 2, column x: '1.234,5'"),
        ("rows", 20, "t_s,x\n0,00,1,5\n0,01,2,5\n", "row 2: 4 fields .*semicolons"),
    ],
    ids=lambda v: str(v)[:20],
)
def test_limits_of_a_table(path, monkeypatch, limit, most, text, says):
    monkeypatch.setattr(stimlib.limits, f"recording_{limit}", most)
    refused(RecordingError, says, recording, written(path, text), {"x": "x"})


def test_a_small_archive_of_much_is_refused_without_unpacking(tmp_path):
    """64 MiB of zeros in 65 kB."""
    bomb = described("(67108864,)", "'|u1'", bytes(64 << 20))
    words = recording, zipped(tmp_path / "bomb.npz", ("x.npy", bomb)), {"x": "x"}
    error, most = most_memory(refused, RecordingError, "recording_rows", *words)
    assert "67108864" not in str(error) and most < 8 << 20


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
    taken, most = most_memory(recording, path, {"x": "x"})
    assert taken.info["reports"] == rows and most < 100 * rows + (10 << 20)


LONG = b"\x93NUMPY\1\0" + (10_000).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("x", "packing", "says"),
    [
        (described("(8589934592,)"), None, "recording_rows"),
        (described("(5,)", data=bytes(24)), None, "24 bytes for 5 values of 8"),
        (described("(-1,)"), None, "cannot be read as npz"),
        (described("(1,)", "'<U4000000000'"), None, "cannot be read as npz"),
        (described("(1,)", "[('a', '<f8')]"), None, "not an array"),
        (described("(1,)", "'<f7'"), None, "cannot be read as npz"),
        (array("(" * 99), None, "cannot be read as npz"),
        (b"\x93NUMPY\2\0\xff\xff\xff\xff", None, "cannot be read as npz"),
        (LONG[:-2] + (10_001).to_bytes(2, "little") + bytes(10_001), None, "is large"),
        (LONG + b"[0]".ljust(10_000), None, "not a dictionary"),
        (b"\x93NUMPY\1\0\xff", None, "cannot be read as npz"),
        (described("(3,)", data=bytes(24)), zipfile.ZIP_BZIP2, "another way"),
        # it asks for a dictionary of up to 4 GiB
        (described("(3,)", data=bytes(24)), zipfile.ZIP_LZMA, "another way"),
        (b"hello", None, "cannot be read as npz"),
        (None, None, "3000 .*recording_columns"),
    ],
)
def test_odd_archives(tmp_path, x, packing, says):
    members = (
        [(f"a{i}.npy", b"") for i in range(3000)]
        if x is None
        else [("x.txt" if x == b"hello" else "x.npy", x)]
    )
    path = zipped(tmp_path / "log.npz", *members, packing=packing or zipfile.ZIP_DEFLATED)
    refused(RecordingError, says, recording, path, {"x": "x"})


STEPS = np.arange(4) * 0.01
GOOD = saved(t_s=STEPS, x=STEPS, note=np.array(["a"] * 4))
AT = GOOD.index(b"PK\1\2")


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (GOOD[: AT + 8] + b"\1\0" + GOOD[AT + 10 :], "another way"),
        (GOOD[: AT + 24] + (130).to_bytes(4, "little") + GOOD[AT + 28 :], "read as npz"),
        (GOOD.replace(STEPS.tobytes(), STEPS[::-1].tobytes(), 1), "read as npz .*CRC"),
        (GOOD.replace(b"a\0\0\0", b"\xff\xff\xff\x7f", 1), "column note: .*read as npz"),
        (GOOD[:-30], "read as npz"),
        (GOOD[:40], "read as npz"),
        (b"t_s,x\n0,1\n", "read as npz"),
        (b"PK\x03\x04", "read as npz"),
        (GOOD.replace(b"NUMPY", b"NUMPX"), "read as npz|not an array"),
    ],
)
def test_an_archive_that_is_damaged_or_lies(tmp_path, data, says):
    (tmp_path / "log.npz").write_bytes(data)
    how = {"where": {"note": "a"} if "note" in says else {}}
    refused(RecordingError, says, recording, tmp_path / "log.npz", {"x": "x"}, **how)


def test_only_the_columns_in_use_are_unpacked(tmp_path):
    """Damage in an array that is not used does not matter."""
    t, path = np.arange(4000) * 0.01, tmp_path / "log.npz"
    data = saved(t_s=t, x=t, other=t + 5).replace((t + 5).tobytes(), (t + 6).tobytes(), 1)
    assert recording(written(path, data), {"x": "x"}, max_speed=None).info["reports"] == 4000
    refused(RecordingError, "column other: .*read as npz", recording, path, {"x": "other"})


def test_a_name_with_an_escape_is_shown_as_a_code(tmp_path):
    path = written(tmp_path / "a\x1b[31m.csv", "t_s,x\x1b[2J\n0,0\n0.01,0\n")
    error = refused(RecordingError, None, recording, path, {"x": "x"})
    r = recording(path, {"x": "'x\x1b[2J'"})
    for text in (str(error), str(r), repr(r), repr(r.motion["x"])):
        assert "\x1b" not in text and "\\x1b" in text


@pytest.mark.parametrize("large", [tables.LARGE, 0])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_plain_decimals_have_the_bits_of_float(ending, large, tmp_path, monkeypatch):
    """Of 1 to 16 characters, and of what the quick reader leaves to another; those of a
    large table are read by compiled code.
    """
    monkeypatch.setattr(tables, "LARGE", large)
    draw = np.random.default_rng(1)
    cells = ["-0", "0", "-0.0", ".5", "5.", "-.25", "999999999999999", "9999999999999999"]
    for _ in range(4000):
        whole, part = draw.integers(0, 10, size=2) % 8
        digits = "".join(map(str, draw.integers(0, 10, size=whole + part + 1)))
        cells.append("-" * draw.integers(2) + digits[: whole + 1] + "." + digits[whole + 1 :])
    for more in ([], ["1e-3"], [" 7 "], ["+1.5"], ["1.234567890123456789"]):
        path = tmp_path / "cells.csv"
        rows = [f"{k},{cell}" for k, cell in enumerate([*cells, *more])]
        path.write_bytes(ending.join(["t,x", *rows, ""]).encode())
        found = np.concatenate([b.numbers(["t", "x"]) for b in read_table(path).batches()], axis=1)
        assert found[1].tobytes() == np.array([float(cell) for cell in [*cells, *more]]).tobytes()
        assert found[0].tolist() == list(range(len(rows)))
