"""Tables in binary formats of others: MATLAB's .mat, XDF by pyxdf, and C3D by py-c3d.

Framing and sizes are checked before anything is unpacked, and before pyxdf gets a file,
so that what is cut off or claims to be huge is refused. No code of a file is run.
SciPy's reader of .mat ends the process at some damaged files, so only the arrays of
numbers are read here. ezc3d, in C++, ended it or never returned at 13 of 1000 damaged
C3D files, and reads what is cut off as a shorter file: so py-c3d, which is Python.
"""

import struct
import warnings
import zlib
from collections.abc import Callable, Container, Iterator
from io import BytesIO
from typing import Any

import numpy as np

from ..errors import RecordingError, counted
from ..system.limits import limits
from ..system.packages import package
from .layout import unpacked
from .npz import EQUAL, batches_of
from .rows import LOST, Batch, Known, reading, table_error

# names, number of rows, batches, and what was skipped or assumed
Read = tuple[tuple[str, ...], int, Callable[[], Iterator[Batch]], tuple[str, ...]]

# -- MATLAB

HEADER = 128  # bytes
MATRIX, COMPRESSED = 14, 15  # types of elements
CLASSES = range(6, 16)  # of arrays of numbers
COMPLEX = 0x800  # in the flags of an array
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
SAVE = "save vectors of numbers with save(.., '-v7'), the fields of a struct s with '-struct', 's'"


def read_mat(file: str, data: bytes, known: Known) -> Read:
    """Read the vectors and matrices of a MATLAB file of version 5 to 7.

    Columns of a matrix x are x_1, x_2, ... All columns in use must have the length of
    most of them.
    """
    columns: dict[str, np.ndarray] = {}
    others, size = [], len(data)
    with reading(file, ".mat", SAVE):
        if data[HEADER - 4 : HEADER] not in (b"\0\1IM", b"\1\0MI"):
            raise table_error(file, "not a MATLAB file of version 5 to 7, and 7.3 is HDF5", SAVE)
        order = "<" if data[HEADER - 2 : HEADER] == b"IM" else ">"
        for kind, element in _elements(data[HEADER:], order, 1):
            if kind == COMPRESSED:
                most = int(min(limits.recording_bytes, 2**40))
                element = zlib.decompressobj().decompress(element, most + 1)
                size += len(element)
                limits.check("recording_bytes", size, f"{file}: unpacked bytes", RecordingError)
                ((kind, element),) = _elements(element, order, 1)
            name, values = _variable(element, order) if kind == MATRIX else ("", None)
            if values is None:
                others += [name] * bool(name)  # MATLAB's own have none
                continue
            limits.check("recording_columns", len(values), f"{file}: columns", RecordingError)
            names = [f"{name}_{k + 1}" if len(values) > 1 else name for k in range(len(values))]
            if twice := sorted(columns.keys() & {*names}):
                raise table_error(file, "two columns have this name", "rename one", None, twice[0])
            columns |= dict(zip(names, values, strict=True))
    if not columns:
        there = ", ".join(others)[:100] or "nothing"
        raise table_error(file, f"there are no arrays of real numbers, but {there}", SAVE)
    lengths: dict[int, list[str]] = {}
    for name, values in columns.items():
        lengths.setdefault(len(values), []).append(name)
    rows = max(lengths, key=lambda n: (known(lengths[n]), n))
    used = lengths.pop(rows)
    for n, names in lengths.items():
        if known(names):
            raise table_error(
                file, f"{counted(n, 'value')}, and {used[0]} has {rows}", EQUAL, None, names[0]
            )
        others += [f"{name} (length {n})" for name in names]
    limits.check("recording_rows", rows, f"{file}: rows", RecordingError)
    notes = (f"variables skipped: {', '.join(others)[:100]}",) if others else ()
    return tuple(used), rows, lambda: batches_of(columns.__getitem__, rows), notes


def _elements(data: bytes, order: str, multiple: int = 8) -> Iterator[tuple[int, bytes]]:
    """Yield types and contents of elements, which begin at multiples of some bytes."""
    at = 0
    while at < len(data):
        kind, length = struct.unpack_from(f"{order}2I", data, at)
        at += 8
        if kind >> 16:  # up to 4 bytes, in place of the length
            kind, length, at = kind & 0xFFFF, kind >> 16, at - 4
        if at + length > len(data):
            raise ValueError("the file is cut off")
        yield kind, data[at : at + length]
        at += length + -(at + length) % multiple


def _variable(data: bytes, order: str) -> tuple[str, np.ndarray | None]:
    """Return the name of a variable, and its columns if it is a matrix of numbers."""
    parts = _elements(data, order)
    (flags,) = struct.unpack_from(f"{order}I", next(parts)[1])
    # of class 17, which strings, times and tables have, there is no shape
    shape = [] if flags & 0xFF == 17 else np.frombuffer(next(parts)[1], f"{order}u4").tolist()
    name = next(parts)[1].decode()
    if flags & 0xFF not in CLASSES or flags & COMPLEX or len(shape) != 2 or not name:
        return name, None
    kind, numbers = next(parts)
    values = np.frombuffer(numbers, order + TYPES[kind]).reshape(shape[::-1])
    return name, values.T if shape[0] == 1 else values


# -- XDF

ITEM = {"double64": 8, "float32": 4, "int64": 8, "int32": 4, "int16": 2, "int8": 1}  # bytes
STREAM_HEADER, SAMPLES = 2, 3  # tags of chunks
BY_HAND = "copy it again, or load it with pyxdf, which leaves out what is damaged, and give arrays"
Chunks = dict[int, list[tuple[int, int]]]  # samples and bytes of each, by stream


def read_xdf(file: str, data: bytes, known: Known) -> Read:
    """Read the stream of numbers of an XDF file that has most of the columns in use.

    Columns are t_s, the labels of channels, and these after the stream's name, type or
    number, such as Tracker.x. Clock offsets are applied and jitter is removed by pyxdf.
    """
    pyxdf = package("pyxdf", "an XDF file")
    if data.startswith(b"\x1f\x8b"):
        data = unpacked(file, data)
    with reading(file, "XDF", BY_HAND), np.errstate(all="ignore"):
        headers, chunks = _chunks(file, data)
        found = [s["info"] for s in pyxdf.load_xdf(BytesIO(headers), synchronize_clocks=False)[0]]
        streams = {
            s["stream_id"]: _columns(file, s, chunks[s["stream_id"]])
            for s in found
            if s["channel_format"][0] in ITEM and s["stream_id"] in chunks
        }
        fit = {n: known([*names]) for n, names in streams.items()}
        chosen = [n for n in streams if fit[n] == max(fit.values())]
        if len(chosen) != 1:
            names = ", ".join(c for n in chosen for c in streams[n] if "." in c)[:200]
            remedy = f"use those of one, by name, type or number: {names or 'there is none'}"
            raise table_error(file, f"the columns are in {len(chosen)} streams of numbers", remedy)
        wanted = sum(count for count, _ in chunks[chosen[0]])
        limits.check("recording_rows", wanted, f"{file}: rows", RecordingError)
        (s,) = pyxdf.load_xdf(BytesIO(data), chosen, dejitter_timestamps=False)[0]
        stamps, rate = s["time_stamps"], float(s["info"]["nominal_srate"][0])
        if rate > 0:
            (s,) = pyxdf.load_xdf(
                BytesIO(data),
                chosen,
                jitter_break_threshold_samples=0,
                jitter_break_threshold_seconds=_silence(stamps, 1 / rate),
            )[0]
        rows = len(s["time_stamps"])
        # those beyond the number in the footer are none: liblsl, issue 246
        stated = ((s.get("footer") or {}).get("info") or {}).get("sample_count") or ()
        if rows != wanted and str(rows) not in stated:
            raise table_error(file, f"pyxdf reads {rows} of {counted(wanted, 'sample')}", BY_HAND)
        channels = {name: s["time_series"][:, k] for name, k in streams[chosen[0]].items()}
        columns = {**channels, "t_s": s["time_stamps"]}
        even = bool((s["time_stamps"] != stamps).any())
        note = (
            f"stream {(s['info']['name'] or [''])[0]}:"
            f" {counted(len(s['clock_times']), 'clock offset')} applied{', times made even' * even}"
        )
    return tuple(columns), rows, lambda: batches_of(columns.__getitem__, rows), (note,)


def _silence(t: np.ndarray, period: float) -> float:
    """Return a time just below the shortest silence in which rows were lost.

    A program that was late sends the rows of a silence at its end; they were not lost.
    It is at most pyxdf's own limit, 1 s and 500 periods, which is for steps back, too.
    """
    steps = np.diff(t)
    late = np.append(0.0, np.cumsum(steps - period))
    long = np.flatnonzero(steps > max(LOST[0] * period, LOST[1])).tolist()
    then = ((steps[i], late[i + 1 :][: LOST[0] + int(steps[i] / period)]) for i in long)
    lost = [s for s, x in then if x[0] - x.min() < min((len(x) - 1) * period, s) / 2]
    return float(min([*lost, max(1.0, 500 * period)])) * (1 - 1e-9)


def _chunks(file: str, data: bytes) -> tuple[bytes, Chunks]:
    """Return the headers of streams as an XDF file, and the sizes of their chunks."""
    headers, chunks, at = [data[:4]], Chunks(), 4
    while at < len(data):
        start = at
        length, at = _whole(data, at)
        end = at + length
        if end > len(data) or length < 2:
            raise table_error(file, "the file is cut off or damaged", BY_HAND)
        tag = int.from_bytes(data[at : at + 2], "little")
        if tag == STREAM_HEADER:
            headers.append(data[start:end])
        if tag == SAMPLES:
            count, first = _whole(data, at + 6)
            stream = int.from_bytes(data[at + 2 : at + 6], "little")
            chunks.setdefault(stream, []).append((count, end - first))
        at = end
    return b"".join(headers), chunks


def _whole(data: bytes, at: int) -> tuple[int, int]:
    """Return a whole number after the byte that has its size, and where it ends."""
    if data[at] not in (1, 4, 8):
        raise ValueError(f"a number of {data[at]} bytes at byte {at}")
    end = at + 1 + data[at]
    return int.from_bytes(data[at + 1 : end], "little"), end


def _columns(file: str, info: Any, chunks: list[tuple[int, int]]) -> dict[str, int]:
    """Return the columns of a stream, whose chunks must have room for their samples.

    Channels without labels of their own are channel1, channel2, ...
    """
    count = int(info["channel_count"][0])
    limits.check("recording_columns", count, f"{file}: channels", RecordingError)
    size = count * ITEM[info["channel_format"][0]]
    for samples, length in chunks:
        if not samples * (1 + size) <= length <= samples * (9 + size):  # with or without a time
            raise table_error(
                file,
                f"{counted(samples, 'sample')} in a chunk of {counted(length, 'byte')}",
                BY_HAND,
            )
    try:
        labels = [c["label"][0].strip() for c in info["desc"][0]["channels"][0]["channel"]]
    except (AttributeError, LookupError, TypeError):
        labels = []
    if len(labels) != count or len({*labels, "t_s"}) <= count:
        labels = [f"channel{k + 1}" for k in range(count)]
    of = [
        "",
        *(f"{(info[what] or [''])[0]}." for what in ("name", "type")),
        f"{info['stream_id']}.",
    ]
    return {"t_s": -1, **{prefix + name: k for prefix in of for k, name in enumerate(labels)}}


# -- C3D

ANEW = "export it anew, or export its table as CSV"
KINDS = {"POINT": "point", "ANALOG": "channel"}  # groups of parameters


def read_c3d(file: str, data: bytes, known: Known) -> Read:
    """Read the points and the analog channels of a C3D file.

    Columns are t_s, which is 0 in the first frame, Label.X, Label.Y and Label.Z of each
    point, and the labels of channels. What has no label of its own is point1, point2,
    ... or channel1, channel2, ... With a channel in use, there is a row for each of its
    samples, and coordinates are missing between frames.
    """
    c3d = package("c3d", "a C3D file")
    with reading(file, "C3D", ANEW), warnings.catch_warnings(record=True) as more:
        warnings.simplefilter("ignore")  # it names parameters that files need not have
        warnings.filterwarnings("always", "incomplete reading of data")
        reader = c3d.Reader(BytesIO(data))
        points, channels = int(reader.point_used), int(reader.analog_used)
        limits.check("recording_columns", 3 * points + channels, f"{file}: columns", RecordingError)
        count, rate = int(reader.frame_count), float(reader.point_rate)
        if first := reader.get("TRIAL:ACTUAL_START_FIELD"):  # py-c3d 0.6 takes 65535 for 2**16
            count += int(reader.first_frame) - int(first.uint16_array @ [1, 1 << 16])
        limits.check("recording_rows", count, f"{file}: rows", RecordingError)
        frames = [(xyz, values) for _, xyz, values in reader.read_frames()][:count]
        if len(frames) != count or not frames or not 0 < rate < np.inf:
            raise table_error(
                file, f"{len(frames)} of {counted(count, 'frame')} at {rate:g} Hz", ANEW
            )
        coordinates = np.array([xyz for xyz, _ in frames], dtype=np.float64)
        coordinates[coordinates[..., 3] < 0] = np.nan  # hidden points
        labels = _labels(reader, "POINT", points)
        of_points = {
            f"{n}.{axis}": (k, j) for k, n in enumerate(labels) for j, axis in enumerate("XYZ")
        }
        notes = [
            f"{counted(points, 'point')}{_units(reader, 'POINT')},"
            f" {counted(count, 'frame')} at {rate:g} Hz"
        ]
        notes += ["the file goes on after the last frame that its header states"] * len(more)
        of_channels: dict[str, np.ndarray] = {}
        step = each = 1  # samples of a channel, and rows, in each frame
        if channels:
            labels = _labels(reader, "ANALOG", channels, {"t_s", *of_points})
            samples = np.concatenate([values for _, values in frames], axis=1)
            of_channels, step = dict(zip(labels, samples, strict=True)), samples.shape[1] // count
            each = step if known(labels) or not points else 1
            notes.append(
                f"{counted(channels, 'channel')}{_units(reader, 'ANALOG')} at {rate * step:g} Hz"
            )
        rows = count * each
        limits.check("recording_rows", rows, f"{file}: rows", RecordingError)

    def column(name: str) -> np.ndarray:
        if name == "t_s":
            return np.arange(rows) / (rate * each)
        if name in of_channels:
            return of_channels[name][:: step // each]
        k, j = of_points[name]
        values = np.full(rows, np.nan)
        values[::each] = coordinates[:, k, j]
        return values

    return (
        ("t_s", *of_points, *of_channels),
        rows,
        lambda: batches_of(column, rows),
        tuple(notes),
    )


def _texts(reader: Any, group: str, name: str) -> list[str]:
    found = reader.get(f"{group}:{name}")
    return [text.strip(" \0") for text in found.string_array] if found else []


def _units(reader: Any, group: str) -> str:
    units = ", ".join(dict.fromkeys(_texts(reader, group, "UNITS")))
    return f" in {units[:60]}" if units else ""


def _labels(reader: Any, group: str, count: int, taken: Container[str] = ()) -> list[str]:
    """Return a label of its own for each point or channel."""
    more = range(2, 2 + (count - 1) // 255)  # a parameter has 255 of them at most
    given = [text for n in ("", *more) for text in _texts(reader, group, f"LABELS{n}")]
    labels: list[str] = []
    for k in range(count):
        label = given[k] if k < len(given) else ""
        own = label and label not in taken and label not in labels
        labels.append(label if own else f"{KINDS[group]}{k + 1}")
    return labels
