"""Tables as laboratories have them: each dialect gives the numbers that pandas gives
with its options stated, or is refused by name.
"""

import gzip
from io import BytesIO

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st
from laws import STRESS
from refusals import refused
from written import written

import stimlib
from stimlib.errors import BadValue, RecordingError
from stimlib.experiments.reader import csv_of
from stimlib.files import audio
from stimlib.motion import recording, table as tables
from stimlib.motion.reports import known_in
from stimlib.motion.table import read_table

T = [0.0, 0.01, 0.02, 0.03]
X = [1.0, -2.5, 3.125, 4e-3]
ROWS = [f"{t},{x},{k}" for t, x, k in zip(T, X, "aabb", strict=True)]
PLAIN = "\n".join(["t_s,x,kind", *ROWS, ""])
TABS, PIPES = PLAIN.replace(",", "\t"), PLAIN.replace(",", "|")
SPACES, EUROPE = PLAIN.replace(",", "   "), PLAIN.replace(",", ";").replace(".", ",")
WIDE = "".join(
    f"{a:>10}{b:>12}\n"
    for a, b in [("t_s", "x"), *((str(t), str(x)) for t, x in zip(T, X, strict=True))]
)
META = "Tracker 3.1\nSubject: P01, left\nDate\t2026-05-01\n\n"
QUOTED = PLAIN.replace("a\n", '"a, or\nnot"\n')
MU = PLAIN.replace("kind", "kraft_µN")

# a table, the options of pandas, and what is noted
TAKEN = {
    "commas": (PLAIN, {}, ""),
    "commas and blanks": (PLAIN.replace(",", ", "), {"skipinitialspace": True}, ""),
    "commas and tabs": (PLAIN.replace(",", ",\t"), {"sep": ",\t", "engine": "python"}, ""),
    "CRLF": (PLAIN.replace("\n", "\r\n"), {}, ""),
    "CR": (PLAIN.replace("\n", "\r"), {}, ""),
    "no end of the last line": (PLAIN.rstrip(), {}, "the last line has no end: it may be cut off"),
    "quotes": (PLAIN.replace("t_s", '"t_s"').replace("a\n", '"a"\n'), {}, ""),
    "quoted numbers": (PLAIN.replace("-2.5", '"-2.5"'), {}, ""),
    "ends of lines in quotes": (QUOTED, {}, ""),
    "a name alike before it": (
        "\uff58," + PLAIN.removesuffix("\n").replace("\n", "\n7,") + "\n",
        {},
        "",
    ),
    "tabs": (TABS, {"sep": "\t"}, "separated by tabs"),
    "tabs, empty text": (TABS.replace("a\n", "\n"), {"sep": "\t"}, ""),
    "bars": (PIPES, {"sep": "|"}, r"separated by \|"),
    "spaces": (SPACES, {"sep": r"\s+"}, "separated by spaces"),
    "fixed width": (WIDE, {"sep": r"\s+"}, "separated by spaces"),
    "spaces and tabs": (SPACES.replace("   ", " \t "), {"sep": r"\s+"}, ""),
    "spaces, quotes": (SPACES.replace("b\n", '"b c"\n'), {"sep": r"\s+"}, ""),
    "semicolons, decimal commas": (EUROPE, {"sep": ";", "decimal": ","}, ""),
    "semicolons, decimal points": (PLAIN.replace(",", ";"), {"sep": ";"}, ""),
    "tabs, decimal commas": (
        EUROPE.replace(";", "\t"),
        {"sep": "\t", "decimal": ","},
        "decimal commas",
    ),
    "spaces, decimal commas": (EUROPE.replace(";", " "), {"sep": " ", "decimal": ","}, ""),
    "bars, decimal commas": (EUROPE.replace(";", "|"), {"sep": "|", "decimal": ","}, ""),
    "Excel's hint": ("sep=;\n" + EUROPE, {"sep": ";", "decimal": ",", "skiprows": 1}, ""),
    "Excel's hint of tabs": ("sep=\t\n" + TABS, {"sep": "\t", "skiprows": 1}, ""),
    "numbers in the names": (PLAIN.replace("kind", "7"), {}, ""),
    "# above": ("# by hand\n#\n" + PLAIN, {"comment": "#"}, "2 comments above"),
    "% above": ("% by hand\n" + PLAIN, {"comment": "%"}, "1 comment above"),
    "# within": (PLAIN.replace("0.02", "# a pause\n0.02"), {"comment": "#"}, "first in row 4"),
    "% within": (TABS.replace("0.02", "% 1 pause\n0.02"), {"comment": "%", "sep": "\t"}, "row 4"),
    "# and quotes": ('# "open\n' + QUOTED, {"comment": "#"}, ""),
    "names in a comment of numpy": (
        "# t_s x\n" + "\n".join(f"{t:.18e} {x:.18e}" for t, x in zip(T, X, strict=True)),
        {"sep": " ", "skiprows": 1, "names": ["t_s", "x"]},
        "names taken from the comment in row 1",
    ),
    "names in a comment of MATLAB": (
        "% made by MATLAB\n%t_s,x,kind\n" + "\n".join(ROWS),
        {"skiprows": 2, "names": ["t_s", "x", "kind"]},
        "names taken from the comment in row 2",
    ),
    "a column of signs": ("id,t_s,x\n" + "".join(f"#1,{r[:-2]}\n" for r in ROWS), {}, ""),
    "lines above": (META * 40 + PLAIN, {"skiprows": 160}, "120 lines above the names skipped"),
    "lines above, in columns": (
        "Subject,P01,\nRate,100,Hz\n" + PLAIN,
        {"skiprows": 2},
        "2 lines above",
    ),
    "lines above tabs": (META + TABS, {"skiprows": 4, "sep": "\t"}, "3 lines above"),
    "lines above spaces": (META + SPACES, {"skiprows": 4, "sep": r"\s+"}, "3 lines above"),
    "a name and a number above": (
        "Rate,100\n" + "".join(f"{line.rpartition(',')[0]}\n" for line in PLAIN.split()),
        {"skiprows": 1},
        "1 line above",
    ),
    "a number sign in the first row": (
        "\n".join(map(",".join, zip(["n", "#1", "2", "3", "4"], PLAIN.split("\n"), strict=False))),
        {},
        "",
    ),
    "units": (
        PLAIN.replace("kind\n", "kind\ns,mm,-\n"),
        {"skiprows": [1]},
        "units in row 2 not applied: s, mm, -",
    ),
    "units in brackets": (
        TABS.replace("kind\n", "kind\n[s]\t[m s^-1]\t\n"),
        {"skiprows": [1], "sep": "\t"},
        "units in row 2",
    ),
    "lines above and units": (
        META + PLAIN.replace("kind\n", "kind\ns,N/m,\n"),
        {"skiprows": [0, 1, 2, 3, 5]},
        "units in row 6",
    ),
    "blank lines": (PLAIN.replace("\n", "\n\n"), {}, "4 blank lines skipped, the first in row 2"),
    "blank lines at the end": (PLAIN + "\n  \n\n", {}, "^$"),
    "blank lines above": ("\n\n" + PLAIN, {}, ""),
    "blank lines with tabs": (TABS.replace("0.02", "\n0.02"), {"sep": "\t"}, "first in row 4"),
    "rows end with a separator": (
        PLAIN.replace("\n", ",\n").replace("kind,", "kind"),
        {"index_col": False},
        "each row ends",
    ),
    "all lines end with a separator": (PLAIN.replace("\n", ",\n"), {}, ""),
    "the names end with a separator": (
        PLAIN.replace("kind", "kind,"),
        {"skiprows": 1, "names": ["t_s", "x", "kind"]},
        "",
    ),
    "rows end with a tab": (
        TABS.replace("\n", "\t\n").replace("kind\t", "kind"),
        {"sep": "\t", "index_col": False},
        "",
    ),
    "a name twice": (PLAIN.replace("t_s,x,kind", "k,t_s,x,k").replace("\n0", "\nq,0"), {}, ""),
    "no name": (PLAIN.replace("t_s", ",t_s").replace("\n0", "\n7,0"), {}, ""),
    "two columns without name": (
        PLAIN.replace("t_s", ",,t_s").replace("\n0", "\n7,,0"),
        {},
        "",
    ),
    "UTF-8 with its mark": (MU.encode("utf-8-sig"), {}, ""),
    "UTF-16": (MU.encode("utf-16"), {"encoding": "utf-16"}, "text in UTF-16"),
    "UTF-16 of the other end": (
        b"\xfe\xff" + MU.encode("utf-16-be"),
        {"encoding": "utf-16"},
        "text in UTF-16",
    ),
    "Windows-1252": (MU.encode("cp1252"), {"encoding": "cp1252"}, "Windows-1252"),
    "gzip": (gzip.compress(PLAIN.encode()), {"compression": "gzip"}, "unpacked with gzip"),
    "gzip in two members": (
        gzip.compress(PLAIN[:40].encode()) + gzip.compress(PLAIN[40:].encode()),
        {"compression": "gzip"},
        "",
    ),
    "gzip of UTF-16 with tabs": (
        gzip.compress(TABS.encode("utf-16")),
        {"compression": "gzip", "encoding": "utf-16", "sep": "\t"},
        "unpacked .*UTF-16.*tabs",
    ),
}
REFUSED = {
    "commas for decimals and columns": (EUROPE.replace(";", ","), "row 2: 5 fields for 3 columns"),
    "a stray decimal comma": (PLAIN.replace("-2.5", "-2,5"), "row 3: 4 fields for 3"),
    "a stray decimal comma, quoted": (PLAIN.replace("-2.5", '"-2,5"'), "row 3, column x: '-2,5'"),
    "a stray decimal comma between tabs": (
        TABS.replace("1.0", "1,2").replace("-2.5", "1.500"),
        "row 3, column x: '1.500'",
    ),
    "thousands between tabs": ("t_s\tx\n0\t1,234\n1\t2,345\n", "row 2, column x: '1,234'"),
    "thousands beside points": (
        "t_s;x\n0.00;998\n0.01;1,000\n",
        "row 3, column x: '1,000' is not",
    ),
    "comments alone": ("# a\n\n" * 200 + PLAIN, "its first 200 lines are comments or blank"),
    "a name without an end": (PLAIN.replace("t_s", "a" * 9999), r"columns are: a{80}, x, kind; "),
    "rows in a quote": (
        PLAIN.replace("a\n", '"a\n', 1).replace("b\n", 'b"\n', 1),
        "opened in row 2",
    ),
    "thousands or decimals": ("t_s;x\n0;1.234\n1;-2.345\n", "row 2, column x: '1.234'.*or have"),
    "thousands beside decimal commas": (
        "t_s;x\n0;1.234\n1;2,345\n",
        "row 2, column x: '1.234'.*thousands",
    ),
    "thousands between semicolons": (EUROPE.replace("1,0", "1.234"), "row 2, column x: '1.234'"),
    "thousands between semicolons, both": (EUROPE.replace("1,0", "1.234,5"), "row 2, column x"),
    "a row that is short": (TABS.replace("0.01\t-2.5\ta", "0.01\t-2.5"), "row 3, column kind: 2"),
    "a row that is long": (PIPES.replace("-2.5", "-2.5|7"), "row 3: 4 fields"),
    "a hole in spaces": (WIDE.replace("-2.5", "    "), "row 3, column x: 1 field for 2"),
    "a name twice that is used": (PLAIN.replace("kind", "x"), "column x: 2 columns have this"),
    "a row behind a sign": (PLAIN.replace("0.02", "#0.02"), "row 4: begins with # and has"),
    "a row behind %": (SPACES.replace("0.02", "% 0.02"), "row 4: begins with % and has"),
    "names alike": (PLAIN.replace("x,kind", "\uff58,\u2179"), "column x: 2 columns have this"),
    "names twice": (PLAIN + PLAIN, "row 6, column t_s: 't_s'"),
    "rows above the names": ("0,1,a\n0.1,2,b\n" + PLAIN, "row 1: this line has numbers"),
    "no names": ("\n".join(ROWS), "the first line must name"),
    "row names of R": (
        "t_s x\n" + "".join(f"{i} {r[:-2]}\n".replace(",", " ") for i, r in enumerate(ROWS)),
        "row 2: 3 fields for 2 columns",
    ),
    "something after the last separator": (
        PLAIN.replace("\n", ",\n").replace("kind,", "kind").replace("b,\n", "b,7\n", 1),
        "row 2: 4 fields for 3 columns",
    ),
    "something after it, late": (
        "t_s,x\n" + "".join(f"{i},1,\n" for i in range(30)) + "30,1,7\n",
        "row 32: '7' stands after the last separator",
    ),
    "text for a number": (TABS.replace("-2.5", "lost"), "row 3, column x: 'lost'"),
    "hexadecimal": (PLAIN.replace("-2.5", "0x1F"), "row 3, column x: '0x1F'"),
    "a missing number": (PLAIN.replace("-2.5", "n/a"), "row 3, column x: 'n/a' .*missing="),
    "an empty cell": (PLAIN.replace("-2.5", ""), "row 3, column x: there is no number.*missing="),
    "half a gzip": (gzip.compress(PLAIN.encode())[:-12], "gzip"),
    "a damaged gzip": (gzip.compress(PLAIN.encode())[:20] + b"????????", "gzip"),
    "UTF-16 without its mark": (PLAIN.encode("utf-16-le"), "not a text file"),
    "bytes of no encoding": (PLAIN.encode() + b"\x81\n", "row 6: neither UTF-8"),
    "a mark of UTF-8 and other bytes": (
        b"\xef\xbb\xbf" + MU.encode("cp1252"),
        "not UTF-8 text, as its first bytes say",
    ),
    "an open quote": (PLAIN.replace("a\n", '"a\n', 1), "not CSV"),
    "a zip": (b"PK\x03\x04\x14\0\0\0", "not a text file"),
}


def numbers(path):
    table = read_table(path, known=known_in(["t_s", "x"]))
    return np.concatenate([b.numbers(["t_s", "x"]) for b in table.batches()], axis=1), table


@pytest.mark.parametrize("name", TAKEN)
def test_a_dialect_has_the_numbers_of_pandas(tmp_path, name):
    text, options, noted = TAKEN[name]
    data = text if isinstance(text, bytes) else text.encode()
    path = written(tmp_path / "log.csv", data)
    frame = pd.read_csv(BytesIO(data), **options)
    wanted = frame.rename(columns=str.strip)[["t_s", "x"]].to_numpy(float).T
    found, table = numbers(path)
    assert np.array_equal(found, wanted) and np.array_equal(found, [T, X])
    says = "; ".join(table.notes())
    assert pd.Series([says]).str.contains(noted).all(), says
    r = recording(path, {"x": "x"}, max_speed=None)
    assert r.info["read"] == table.notes() and all(note in str(r) for note in table.notes())
    assert r.motion["x"](T) == pytest.approx(X)


@pytest.mark.parametrize("name", REFUSED)
def test_a_dialect_is_refused_by_name(tmp_path, name):
    text, says = REFUSED[name]
    path = written(tmp_path / "log.csv", text)
    refused(RecordingError, says, recording, path, {"x": "x"}, max_speed=None)


def test_a_packed_file_is_unpacked_to_the_limit(tmp_path, monkeypatch):
    path = written(tmp_path / "log.csv.gz", gzip.compress(b"t_s,x\n" + b"0,0\n" * 100_000))
    monkeypatch.setattr(stimlib.limits, "recording_bytes", 100_000)
    refused(RecordingError, "unpacked bytes: .*recording_bytes", recording, path, {"x": "x"})


NUMBER = st.floats(-1e6, 1e6).map(lambda v: f"{v:.7g}") | st.sampled_from(["0", "+.5", "1e-7"])
TEXT = st.text("abµé #%", max_size=6).map(str.strip)


@settings(max_examples=150, deadline=None)
@given(
    rows=st.lists(st.tuples(NUMBER, TEXT), min_size=2, max_size=12),
    separator=st.sampled_from([",", ";", "\t", "|", " "]),
    decimal=st.sampled_from(".,"),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    end=st.sampled_from(["\n", "\r\n"]),
    above=st.lists(st.sampled_from(["# by hand", "%", "", "Tracker: 3 and more"]), max_size=4),
    within=st.lists(st.sampled_from(["", "# by hand", "% 1"]), max_size=3),
    units=st.booleans(),
    trailing=st.booleans(),
    packed=st.booleans(),
)
def test_any_dialect_has_its_numbers(
    tmp_path_factory,
    rows,
    separator,
    decimal,
    encoding,
    end,
    above,
    within,
    units,
    trailing,
    packed,
):
    """What is written is read, or refused: nothing else is taken."""
    if separator == ",":
        decimal = "."
    lines = [separator.join(("t_s", "note", "x"))]
    lines += [separator.join(("s", "-", "mm"))] if units else []
    for i, (x, note) in enumerate(rows):
        note = f'"{note}"' if separator == " " or not note else note
        cells = [f"{i * 0.25:.2f}", note, x]
        lines.append(
            separator.join(c if k == 1 else c.replace(".", decimal) for k, c in enumerate(cells))
            + (separator if trailing and separator != " " else "")
        )
    text = end.join([*above, *lines[: 3 + units], *within, *lines[3 + units :], ""])
    data = text.encode(encoding)
    path = written(
        tmp_path_factory.getbasetemp() / "any.csv", gzip.compress(data) if packed else data
    )
    try:
        found, _ = numbers(path)
    except RecordingError as error:
        assert "row " in str(error)
        return
    except ValueError:  # a number with a point among decimal commas
        return
    wanted = [[i * 0.25 for i in range(len(rows))], [float(x) for x, _ in rows]]
    assert np.array_equal(found, wanted)


# -- times


@pytest.mark.parametrize(
    ("times", "start", "says"),
    [
        (["12:30:00.00", "12:30:00.01", "12:30:00.03"], 45000, "since midnight"),
        (["0:00:59,99", "0:01:00,00", "0:01:00,02"], 59.99, "since midnight"),
        (["2026-05-01 23:59:59.99", "2026-05-02 00:00:00", "2026-05-02 00:00:00.02"], 86399.99,
            "first midnight"),
        (["2026-05-01T23:59:59.99Z", "2026-05-02T05:30:00+05:30", "2026-05-01T22:00:00.02-0200"],
            86399.99, "first midnight, UTC"),
        (["2024-02-28T23:59:59.99", "2024-02-29T00:00:00.0", "2024-02-29T00:00:00.020000"],
            86399.99, "first midnight"),
    ],
)  # fmt: skip
def test_times_of_day(tmp_path, times, start, says):
    path = written(
        tmp_path / "log.txt", "when\tx\n" + "".join(f"{t}\t{i}\n" for i, t in enumerate(times))
    )
    r = recording(path, {"x": "x*1e-3"}, time="when")
    assert r.info["start"] == pytest.approx(start) and says in str(r)
    assert r.motion["x"]._knots == pytest.approx([0, 0.01, 0.03], abs=1e-9)


def test_times_of_day_may_begin_later(tmp_path):
    text = "t_s,x\n,0\n-,0\n12:30:00.00,1\n12:30:00.01,2\n"
    how = {"missing": "hold", "sentinels": ("-",), "max_speed": None}
    when = pd.Series(
        [pd.NaT, pd.NaT, *pd.to_datetime([0, 10], unit="ms", origin="2026-05-01 12:30")]
    )
    frame = pd.DataFrame({"t_s": when, "x": [0, 0, 1, 2]})  # whose missing times are NaT
    for source in (written(tmp_path / "log.csv", text), frame):
        r = recording(source, {"x": "x"}, **how)
        assert r.info["start"] == 45_000 and "2 rows without a time left out" in str(r)


@pytest.mark.parametrize(
    ("times", "how", "says"),
    [
        (["12:30:00", "12:31"], {}, "row 3, column t_s: '12:31' is not a time as"),
        (["12:30:00", "0.5"], {}, "row 3, column t_s: '0.5' is not a time as"),
        (["0.5", "12:30:00"], {}, "row 3, column t_s: .* give times of day as the time"),
        (["12:30:00", "2026-05-01 12:30:01"], {}, "row 3, column t_s"),
        (["12:30:00Z", "12:30:01"], {}, "row 3, column t_s: '12:30:01' is not a time as"),
        (["2026-02-30 12:30:00"] * 2, {}, "row 2, column t_s: '2026-02-30"),
        (["2026-02-20 24:30:00"] * 2, {}, "row 2, column t_s"),
        (["01/05/2026 12:30:00"] * 2, {}, "row 2, column t_s"),
        (["12:30:00 PM"] * 2, {}, "row 2, column t_s"),
        *(
            (["12:30:00", "12:30:01"], {"time": time}, "give times of day as the time, without")
            for time in ("t_s*1e-3", "t_s - 5")
        ),
        (
            ["23:59:59.98", "23:59:59.99", "0:00:00.00"],
            {},
            "begins again after 86400 s; say wrap=86400",
        ),
    ],
)
def test_times_of_day_that_are_refused(tmp_path, monkeypatch, times, how, says):
    monkeypatch.setattr(tables, "PIECE", 16)  # each row is read by itself
    path = written(
        tmp_path / "log.csv", "t_s,x\n" + "".join(f"{t},{i}\n" for i, t in enumerate(times))
    )
    refused(RecordingError, says, recording, path, {"x": "x"}, **how)


def test_names_that_are_no_expressions_are_found(tmp_path):
    found = recording(
        written(tmp_path / "a.csv", "Tracker 3.1,left\nTime (s),Force (N)\n0,1\n0.01,2\n"),
        {"x": "Force (N)"},
        time="Time (s)",
        max_speed=None,
    )
    assert found.motion["x"]([0.0, 0.01]).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("ends", [("", "", ""), ("\t\t", "", ""), ("\t\t", "\t", "\t")])
def test_names_in_two_lines(tmp_path, ends):
    """A .trc of OpenSim: with two markers, its line of numbers is as long as a row."""
    head = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
    head += "120.00\t120.00\t3\t2\tmm\t120.00\t1\t3\nFrame#\tTime\tTip\t\t\tThumb" + ends[0]
    head += "\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2" + ends[1] + "\n\n"
    rows = ["1\t0\t5\t6\t7\t1\t2\t3", "2\t.01\t6\t6\t7\t\t\t", "3\t.02\t7\t6\t7\t3\t2\t3"]
    (tmp_path / "a.trc").write_text(head + "".join(row + ends[2] + "\n" for row in rows))
    how = {"time": "Time", "missing": "interpolate", "max_speed": None}
    found = recording(tmp_path / "a.trc", {"x": "hypot(X1 - X2, Y1 - Y2, Z1 - Z2)"}, **how)
    assert found.motion["x"](0.01) == pytest.approx(48**0.5)
    assert "names in row 5 completed from the row above" in found.info["read"]


@pytest.mark.parametrize("ends", [(",,", ""), ("", ""), (",,", ",")])
def test_names_below_those_of_groups(tmp_path, ends):
    """A table of Vicon, whose X, Y and Z come once for each marker."""
    head = f"Trajectories\n120\n,,P:Tip,,,P:Thumb{ends[0]}\n"
    head += f"Frame,Sub,X,Y,Z,X,Y,Z{ends[1]}\n,,mm,mm,mm,mm,mm,mm{ends[1]}\n"
    rows = "".join(f"{k},0,{k},5,6,{9 - k},7,8{ends[1]}\n" for k in range(1, 5))
    (tmp_path / "a.csv").write_text(head + rows)
    how = {"time": "Frame/120", "max_speed": None}
    found = recording(tmp_path / "a.csv", {"x": "'P:Tip.X'", "z": "'P:Thumb.X'*2"}, **how)
    assert found.motion["x"](np.arange(4) / 120).tolist() == pytest.approx([1, 2, 3, 4])
    assert found.motion["z"](np.arange(4) / 120).tolist() == pytest.approx([16, 14, 12, 10])
    assert "names in row 4 completed from the row above" in found.info["read"]
    says = "column X: 2 columns have this name"
    refused(RecordingError, says, recording, tmp_path / "a.csv", {"x": "X"}, **how)


def test_a_sidecar_has_what_was_skipped(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.tsv").write_text(TABS)
    scene = stimlib.Scene({"y": 1.0 * stimlib.Input("x", "m")})
    proc = stimlib.compile(scene, 8000.0, "python")
    for source, notes in (("log.tsv", ["separated by tabs"]), ({"t_s": T, "x": X}, None)):
        motion = recording(source, {"x": "x"}, max_speed=None).motion_for(scene.inputs)
        audio.write("a.wav", proc, motion, 0.02, progress=False)
        assert audio.read("a.wav")[1].get("motion_read") == ({"x": notes} if notes else None)
        assert stimlib.verify(scene, motion, "a.wav").passed
        proc.reset()


# Tables for Excel ---------------------------------------------------------------------
FINITE = st.floats(allow_nan=False, allow_infinity=False)
WORDS = st.text('aé;,|\t" \n#%1.-', max_size=6)


@settings(max_examples=500 if STRESS else 40)
@given(st.lists(st.tuples(FINITE, WORDS), min_size=1, max_size=6), st.booleans())
def test_tables_that_stimlib_writes_are_read_back(tmp_path_factory, rows, bom):
    path = tmp_path_factory.mktemp("out") / "answers.csv"
    values, words = zip(*rows, strict=True)
    table = {"t_s": [k / 8 for k in range(len(rows))], "level": values, "words": words}
    for separator, decimal in ((s, d) for s in (",", ";", "tab", "|") for d in ".," if s != d):
        text = csv_of(table, separator, decimal, bom)
        assert text.count("\ufeff") == bom
        path.write_text(text, "utf-8", newline="")
        got = read_table(path, known=lambda names: len({"t_s", "level"} & set(names)))
        assert got.names == ("t_s", "level", "words")
        for batch in got.batches():
            if separator in ",;":  # elsewhere a comma must be shown to be a decimal sign
                assert batch.numbers(["level"]).tolist() == [[*values]]
            assert [w.lstrip(" ") for w in batch.texts("words")] == [w.lstrip(" ") for w in words]
        sep = {"tab": "\t"}.get(separator, separator)
        pandas = pd.read_csv(path, sep=sep, decimal=decimal)["level"]
        assert pandas.tolist() == pytest.approx([*values], rel=1e-14, abs=1e-300)


def test_other_signs_of_tables_are_refused():
    for words in ({"separator": "::"}, {"separator": ""}, {"decimal": ";"}, {"decimal": ","}):
        refused(BadValue, "separate columns by , ; | or tab, and", csv_of, {"a": [1.5]}, **words)
    assert csv_of({"a": [1.5, "1.5", None, True, 2]}, ";", ",") == 'a\n1,5\n1.5\n""\nTrue\n2\n'
    assert csv_of({"a": [np.float32(2.5), "b\rc\r\n"]}, ";", ",") == 'a\n2,5\n"b\nc\n"\n'
