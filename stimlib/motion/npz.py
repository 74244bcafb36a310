"""Reading of arrays from .npz files, with sizes checked before allocation."""

import io
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np

from ..errors import RecordingError, counted
from ..system.limits import limits
from .rows import Array, Batch, Rows, reading, table_error

SAVE = "save arrays of numbers with numpy.savez"
EQUAL = "save one-dimensional arrays of equal length"
MAX_HEADER = 10_000  # bytes of the header of an array
READERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
BATCH = 1 << 17  # rows


@dataclass(frozen=True)
class _Member:
    """An array in a file: position, number and type of its values."""

    info: zipfile.ZipInfo
    offset: int
    dtype: np.dtype
    count: int


def read_npz(file: str, data: bytes) -> tuple[tuple[str, ...], int, Callable[[], Iterator[Batch]]]:
    """Return the column names, the number of rows and the rows of an npz file."""
    # one for each member
    limits.check("recording_columns", data.count(b"PK\1\2"), f"{file}: arrays", RecordingError)
    members: dict[str, _Member] = {}
    with reading(file, "npz", SAVE), zipfile.ZipFile(io.BytesIO(data)) as z:
        size = sum(i.file_size for i in z.infolist())
        limits.check("recording_bytes", size, f"{file}: unpacked bytes", RecordingError)
        for info in z.infolist():
            name = info.filename.removesuffix(".npy")
            if name in members:
                raise table_error(file, "two arrays have this name", "rename one", None, name)
            with reading(file, "npz", SAVE, name):
                members[name] = _member(file, name, z, info)
            first = next(iter(members))
            if members[name].count != members[first].count:
                problem = (
                    f"{counted(members[name].count, 'value')}, but {first} has"
                    f" {members[first].count}"
                )
                raise table_error(file, problem, EQUAL, None, name)
    if not members:
        raise table_error(file, "there are no arrays", SAVE)
    most = next(iter(members.values())).count
    return tuple(members), most, lambda: _batches(file, data, members, most)


def _member(file: str, name: str, z: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Member:
    """Read and check the header of an array in an npz file."""
    if info.flag_bits & 1 or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("packed in another way than numpy does")
    with z.open(info) as f:
        read = READERS[np.lib.format.read_magic(f)]
        shape, _, dtype = read(f, max_header_size=MAX_HEADER)
        offset = f.tell()
    if dtype.hasobject:
        raise ValueError("it holds objects of Python, which numpy reads with allow_pickle only")
    if dtype.kind not in "biufU":
        raise table_error(
            file, "not an array of numbers or texts", "save arrays of numbers", None, name
        )
    if len(shape) != 1:
        raise table_error(file, f"shape {shape}", EQUAL, None, name)
    limits.check("recording_rows", shape[0], f"{file}, column {name}: values", RecordingError)
    if dtype.itemsize * prod(shape) != info.file_size - offset:
        raise ValueError(
            f"{counted(info.file_size - offset, 'byte')} for {counted(shape[0], 'value')}"
            f" of {dtype.itemsize}"
        )
    return _Member(info, offset, dtype, shape[0])


def _batches(file: str, data: bytes, members: dict[str, _Member], count: int) -> Iterator[Batch]:
    unpacked: dict[str, np.ndarray] = {}

    def column(name: str) -> np.ndarray:
        if name not in unpacked:
            with reading(file, "npz", SAVE, name):
                with zipfile.ZipFile(io.BytesIO(data)) as z, z.open(members[name].info) as f:
                    f.read(members[name].offset)
                    values = f.read(members[name].info.file_size)
                dtype = members[name].dtype
                if (
                    dtype.kind == "U"
                    and (np.frombuffer(values, dtype.str[0] + "u4") > 0x10FFFF).any()
                ):
                    raise ValueError("texts of characters that are none")
                unpacked[name] = np.frombuffer(values, dtype, count)
        return unpacked[name]

    return batches_of(column, count)


def batches_of(column: Callable[[str], np.ndarray], count: int) -> "Iterator[ArrayBatch]":
    """Yield the rows of columns, whose arrays are asked for when they are used."""
    for at in range(0, count, BATCH):
        rows = np.arange(at, min(at + BATCH, count), dtype=np.int64)
        yield ArrayBatch(column, slice(at, at + BATCH), rows)


@dataclass(frozen=True)
class ArrayBatch:
    """A batch of rows from columns that are arrays of numbers or texts."""

    column: Callable[[str], np.ndarray]
    part: slice
    rows: Rows

    def numbers(self, columns: Sequence[str]) -> Array:
        """Return columns as numbers, shape (columns, rows)."""
        values = [self.column(name)[self.part] for name in columns]
        if any(v.dtype.kind == "U" for v in values):
            raise ValueError
        with np.errstate(over="ignore", invalid="ignore"):  # longer floats, and what is none
            return np.array([v.astype(np.float64) for v in values])

    def texts(self, column: str) -> Sequence[str]:
        """Return a column as texts."""
        return [str(v) for v in self.column(column)[self.part]]
