"""What all rows of a sweep share, and by what a row is known again: content, never order, place or name."""

from __future__ import annotations

import hashlib
import inspect
import json
import platform
import sys
import sysconfig
from collections.abc import Callable, Iterator, Mapping
from copyreg import dispatch_table
from dataclasses import dataclass, is_dataclass
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.bounds import limits
from ..core.definitions import definitions
from ..core.graph import Block, Pick
from ..core.scene import Scene
from ..errors import BadValue
from ..motion.generators import Motion as Generated
from ..motion.recorded import Recording
from ..motion.source import frames_of, sources_of
from .measures import Measure
from .rows import Roles, arrow, name_of

if TYPE_CHECKING:
    import pyarrow as pa

PACKAGES = ("stimlib", "numpy", "scipy", "numba", "llvmlite")
KEY = 16  # bytes
CHUNK = 100_000  # rows that are Python objects at once
INSTALLED = [Path(sysconfig.get_path("stdlib")).resolve(), Path(__file__).resolve().parents[1]]
"""Folders of modules whose versions are recorded, besides those of packages."""


def versions() -> dict[str, str]:
    """Of everything that the bits of a figure may depend on."""
    return {"python": platform.python_version(), **{p: version(p) for p in PACKAGES}}


@dataclass(frozen=True)
class Plan:
    """A sweep without its rows and motions; it travels to every worker once."""

    make: Scene | Callable[..., Scene]
    measures: tuple[str | Measure, ...]
    units: dict[str, str]
    """Of the figures, in their order."""
    fs: float
    seconds: float | None
    roles: Roles
    versions: dict[str, str]
    key: str
    """sha256 of what every row's figures depend on."""

    def scene(self, row: Mapping[str, Any]) -> Scene:
        """The scene of a row."""
        if isinstance(self.make, Scene):
            return self.make
        made = self.make(**{name: row[name] for name in self.roles.arguments})
        if not isinstance(made, Scene):
            raise BadValue(f"{name_of(self.make)} returns {type(made).__name__}, not a Scene")
        return made


# Motions -----------------------------------------------------------------------------------------------------------------
def motion_of(given: Any, scene: Scene) -> dict[str, Any]:
    """The motion of every input of a scene: by name as ``render`` takes it; one function, array or recording is of all inputs."""
    if isinstance(given, Recording):
        return given.for_inputs(scene.inputs)
    return dict(given) if isinstance(given, Mapping) else dict.fromkeys(scene.inputs, given)


def frames(motion: Mapping[str, Any], fs: float, seconds: float | None) -> int:
    """Samples of a run: of ``seconds``, else of the recording or the shortest array."""
    if seconds is None:
        lengths = [len(s) / fs for s in motion.values() if not callable(s)]
        lengths += [s.info["duration"] for s in motion.values() if hasattr(s, "info")]
        if not lengths:
            raise BadValue("motion given as functions of time goes on for ever: say how many seconds each row has")
        seconds = min(lengths)
    n = frames_of(seconds, fs)
    limits.check("render_bytes", 16 * n * max(1, len(motion)), f"sweep: bytes of a row of {seconds:g} s")
    return n


def motion_digest(given: Any, fs: float, seconds: float | None) -> bytes:
    """Content of a motion as it was given, and how much of it is used: 16 bytes."""
    parts = dict(given) if isinstance(given, Mapping) else {"": given}
    text = [float(seconds).hex() if seconds is not None else "own length"]
    for name, source in sorted(parts.items()):
        text.append(f"{name}: {_source(source)}")
    return hashlib.sha256("\n".join(text).encode()).digest()[:KEY]


def _source(source: Any) -> str:
    if callable(source) or isinstance(source, Recording):
        return identity(source)
    values = next(iter(sources_of({"": source}, ("",), 0).values()))
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


# Functions -----------------------------------------------------------------------------------------------------------
def identity(f: Any, seen: dict[int, Any] | None = None) -> str:
    """A text that changes when what a function does changes: its source, and that of the helpers and constants it names.

    Of a callable object, class and state.  Of stimlib's own functions and of installed packages the name: their versions are
    recorded.
    """
    seen = {} if seen is None else seen
    if f is None or isinstance(f, bool | int | float | complex | str | bytes | np.generic):
        return repr(f)
    if id(f) in seen:
        return f"again {list(seen).index(id(f))}"
    seen[id(f)] = f  # kept, so that nothing else gets its number
    if isinstance(f, Measure):
        return f"{dict(f.units)} {identity(f.function, seen)} {identity(f.prepare, seen)}"
    if isinstance(f, Scene):
        return f.hash
    if isinstance(f, Block):
        return Scene({"y": Pick(f, f.outputs[0]) if f.outputs else f}).hash
    if isinstance(f, Generated | Recording):
        return repr(f)  # which makes it again, the file of a recording by its sha256
    if isinstance(f, ModuleType):
        return inspect.getsource(f) if _own(f) else f.__name__
    if isinstance(f, np.ndarray) and not f.dtype.hasobject:
        return f"{f.dtype} {f.shape} {hashlib.sha256(np.ascontiguousarray(f).tobytes()).hexdigest()}"
    if isinstance(f, list | tuple | dict | set | frozenset):
        listed = f.items() if isinstance(f, dict) else sorted(f, key=repr) if isinstance(f, set | frozenset) else f
        return f"{type(f).__name__}({', '.join(identity(v, seen) for v in listed)})"
    return _of_function(f, seen) if isinstance(f, FunctionType) else _of_object(f, seen)


def _of_function(f: FunctionType, seen: dict[int, Any]) -> str:
    if not _own(f):
        return f"{f.__module__}.{f.__qualname__}"
    closed = {name: c.cell_contents for name, c in zip(f.__code__.co_freevars, f.__closure__ or (), strict=True)}
    named = {n: f.__globals__[n] for n in sorted(_names(f.__code__)) if n in f.__globals__} | closed
    used = [f"{n}={identity(v, seen)}" for n, v in named.items() if _counts(n, v)]
    code = repr(_code(f.__code__))  # two lambdas of one line have one text
    return "\n".join([f.__qualname__, _text(f), code, identity(f.__defaults__, seen), identity(f.__kwdefaults__, seen), *used])


def _of_object(f: Any, seen: dict[int, Any]) -> str:
    """Of a class its source, of an instance also what a pickle would hold, of what is wrapped (cached, compiled) the function."""
    kind = f if isinstance(f, type) else type(f)
    text = f"{kind.__module__}.{kind.__qualname__} {_text(kind)}"
    if isinstance(f, type):
        return text
    if hasattr(f, "__wrapped__"):
        return f"{text} {identity(f.__wrapped__, seen)}"
    try:
        state = reduce(f) if (reduce := dispatch_table.get(kind)) else f.__reduce_ex__(4)
    except Exception:  # a lock, an open file: no constant
        return text
    if isinstance(state, str):
        return f"{text} {getattr(f, '__module__', '')}.{state}"
    how, *what = [list(v) if isinstance(v, Iterator) else v for v in state]
    return f"{text} {getattr(how, '__qualname__', '')} {identity(what, seen)}"


def _text(f: Any) -> str:
    try:
        return inspect.getsource(f)
    except (OSError, TypeError):
        return ""


def _code(code: CodeType) -> list[Any]:
    """What runs, without lines and places."""
    constants = [
        _code(c) if isinstance(c, CodeType) else sorted(c, key=repr) if isinstance(c, frozenset) else c for c in code.co_consts
    ]
    return [code.co_code, code.co_exceptiontable, code.co_names, *constants]


def _names(code: CodeType) -> set[str]:
    return set(code.co_names).union(*(_names(c) for c in code.co_consts if isinstance(c, CodeType)))


def _counts(name: str, value: Any) -> bool:
    """Numbers, texts, collections of them, scenes, modules, and what is called or has fields; not what a package made, such as
    ``scipy.stats.norm``, whose content is a random state."""
    holder = sys.modules.get(type(value).__module__)
    packaged = holder is not None and holder.__name__ != "__main__" and not _own(holder)
    if packaged and not isinstance(value, np.ufunc) and getattr(holder, name, None) is value:
        return False
    kinds = (int, float, complex, str, bytes, tuple, list, dict, set, frozenset, np.ndarray, np.generic, ModuleType)
    return isinstance(value, (*kinds, Scene, Block, Recording)) or callable(value) or is_dataclass(value)


def _own(f: Any) -> bool:
    """Whether the source of a function, class or module is there, and not that of a package."""
    try:
        file = Path(inspect.getfile(f))
    except (OSError, TypeError):  # compiled
        return False
    if not isinstance(f, FunctionType) and file.suffix != ".py":
        return False
    packaged = {"site-packages", "dist-packages"} & {*file.parts}
    return not packaged and not any(file.resolve().is_relative_to(folder) for folder in INSTALLED)


def shared_key(
    make: Any, scene: Scene, measures: tuple[str | Measure, ...], fs: float, roles: Roles
) -> tuple[str, dict[str, Any]]:
    """The key of a plan, and the facts that it is made of."""
    facts = {
        "scene": scene.hash if isinstance(make, Scene) else identity(make),
        "blocks": {module: d["sha256"] for module, d in definitions(scene).items()},
        "measures": [identity(m) if isinstance(m, Measure) else m for m in measures],
        "fs": float(fs).hex(),
        "live": sorted(roles.live),
        "arguments": sorted(roles.arguments),
        "versions": versions(),
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest(), facts


# Rows ----------------------------------------------------------------------------------------------------------------
def row_keys(plan: Plan, table: pa.Table, digests: Mapping[str, bytes]) -> pa.Array:
    """16 bytes for each row, of the plan, the row's numbers and the content of its motion.

    Not of order, number or names of motions: a sweep may grow, and parts may have any size.
    """
    pa = arrow()
    n = table.num_rows
    seeds = table["seed"].to_numpy() if "seed" in table.column_names else np.zeros(n, np.uint64)
    columns = [_words(pa, pa.array(seeds))]
    if "motion" in table.column_names:
        columns.append(_digests(pa, table["motion"], digests))
    else:
        columns.append(np.tile(np.frombuffer(digests[""], np.uint8), (n, 1)))
    columns += [_words(pa, table[name]) for name in sorted((*plan.roles.live, *plan.roles.arguments))]
    records = np.concatenate(columns, axis=1)
    shared = hashlib.blake2b(bytes.fromhex(plan.key), digest_size=KEY)

    def key(record: bytes) -> bytes:
        h = shared.copy()  # half the time of a new one
        h.update(record)
        return h.digest()

    whole = records.view(f"V{records.shape[1]}").ravel()
    keys = b"".join(b"".join(map(key, whole[at : at + CHUNK].tolist())) for at in range(0, n, CHUNK))
    return pa.FixedSizeBinaryArray.from_buffers(pa.binary(KEY), n, [None, pa.py_buffer(keys)])


def _words(pa: Any, column: Any) -> np.ndarray:
    """A column as bytes, shape (rows, 16): type and value, or the digest of a text."""
    kind = str(column.type)
    if kind == "string":
        return _digests(pa, column, None)
    words = np.zeros((len(column), KEY), np.uint8)
    words[:, :8] = np.frombuffer(kind.encode().ljust(8), np.uint8)
    values = column.to_numpy(zero_copy_only=False) if isinstance(column, pa.Array) else column.to_numpy()
    wide = values.astype(np.uint64) if kind == "bool" else values
    words[:, 8:] = np.ascontiguousarray(wide).view(np.uint8).reshape(-1, 8)
    return words


def _digests(pa: Any, column: Any, known: Mapping[str, bytes] | None) -> np.ndarray:
    column = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    coded = column.dictionary_encode()
    coded = coded.combine_chunks() if isinstance(coded, pa.ChunkedArray) else coded
    values = [hashlib.sha256(t.encode()).digest()[:KEY] if known is None else known[t] for t in coded.dictionary.to_pylist()]
    return np.frombuffer(b"".join(values), np.uint8).reshape(-1, KEY)[coded.indices.to_numpy()]


def in_order(table: pa.Table, roles: Roles) -> np.ndarray:
    """Indices of the rows by arguments, then motion, then seed: so that little is made twice."""
    names = [n for n in (*roles.arguments, "motion", "seed") if n in table.column_names]
    codes = []
    for name in names:
        column = table[name].combine_chunks()
        codes.append(column.to_numpy() if name == "seed" else column.dictionary_encode().indices.to_numpy())
    return np.lexsort(codes[::-1]) if codes else np.arange(table.num_rows)
