"""What all rows of a sweep share, and by what a row is known again: content, never order, place or name."""

from __future__ import annotations

import hashlib
import inspect
import json
import pickle
import platform
import sys
import sysconfig
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.bounds import limits
from ..core.definitions import definitions
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
    if isinstance(source, Generated | Recording):
        return repr(source)  # which makes it again, the file of a recording by its sha256
    if callable(source):
        return identity(source)
    values = next(iter(sources_of({"": source}, ("",), 0).values()))
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


# Functions -----------------------------------------------------------------------------------------------------------
def identity(f: Any, seen: frozenset[int] = frozenset()) -> str:
    """A text that changes when what a function does changes: its source, and that of the helpers and constants it names.

    Of stimlib's own functions and of installed packages the name: their versions are recorded.
    """
    if isinstance(f, Scene):
        return f.hash
    if isinstance(f, Measure):
        return f"{dict(f.units)} {identity(f.function, seen)} {identity(f.prepare, seen)}"
    if isinstance(f, partial):
        return f"partial({', '.join(identity(p, seen) for p in (f.func, f.args, f.keywords))})"
    if isinstance(f, np.ndarray):
        return f"{f.dtype} {f.shape} {hashlib.sha256(np.ascontiguousarray(f).tobytes()).hexdigest()}"
    if isinstance(f, tuple | list | dict) and id(f) not in seen:
        parts = [*f.items()] if isinstance(f, dict) else [*f]
        return f"{type(f).__name__}({', '.join(identity(p, seen | {id(f)}) for p in parts)})"
    if isinstance(f, FunctionType | type | ModuleType) and not _own(f):
        return f"{getattr(f, '__module__', '')}.{f.__name__}"
    if isinstance(f, ModuleType):
        return inspect.getsource(f)
    if isinstance(f, MethodType):
        return f"{identity(f.__func__, seen)} of {identity(f.__self__, seen)}"
    if isinstance(f, type):
        return f"{f.__module__}.{f.__qualname__} {_text(f)}"
    if not isinstance(f, FunctionType):
        if type(f).__module__ == "builtins" or not (callable(f) or is_dataclass(f)):
            return repr(f)
        return f"{identity(type(f), seen)} {_state(f)}"
    if id(f) in seen:
        return f"{f.__module__}.{f.__qualname__}"
    seen |= {id(f)}
    closed = {name: c.cell_contents for name, c in zip(f.__code__.co_freevars, f.__closure__ or (), strict=True)}
    named = {n: f.__globals__[n] for n in sorted(_names(f.__code__)) if n in f.__globals__} | closed
    used = [f"{n}={identity(v, seen)}" for n, v in named.items() if _counts(n, v)]
    return "\n".join([f.__qualname__, _text(f), identity(f.__defaults__, seen), identity(f.__kwdefaults__, seen), *used])


def _state(f: Any) -> str:
    """The content of an object, such as a spline; where it cannot be pickled, what it says, which may be its address."""
    try:
        return hashlib.sha256(pickle.dumps(f)).hexdigest()
    except Exception:
        return repr(f)


def _text(f: Any) -> str:
    try:
        return inspect.getsource(f)
    except (OSError, TypeError):
        return repr(_code(f.__code__)) if hasattr(f, "__code__") else ""


def _code(code: CodeType) -> tuple[Any, ...]:
    """What runs, without lines and places."""
    return (code.co_code, code.co_names, *(_code(c) if isinstance(c, CodeType) else c for c in code.co_consts))


def _names(code: CodeType) -> set[str]:
    return set(code.co_names).union(*(_names(c) for c in code.co_consts if isinstance(c, CodeType)))


def _counts(name: str, value: Any) -> bool:
    """Numbers, texts, collections of them, functions, classes, modules, and objects that are called or have fields."""
    holder = sys.modules.get(type(value).__module__)
    packaged = holder is not None and holder.__name__ != "__main__" and not _own(holder)
    if isinstance(value, BuiltinFunctionType | np.ufunc) or (packaged and getattr(holder, name, None) is value):
        return False  # the second: what a package made, such as ``scipy.stats.norm``, whose content is a random state
    kinds = (int, float, complex, str, bytes, tuple, list, dict, set, frozenset, np.ndarray, np.generic, ModuleType, Scene)
    return isinstance(value, kinds) or callable(value) or is_dataclass(value)


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
    records = np.concatenate(columns, axis=1).tobytes()
    width, shared = len(records) // n, hashlib.blake2b(bytes.fromhex(plan.key), digest_size=KEY)
    hashed = []
    for i in range(0, len(records), width):
        h = shared.copy()  # half the time of a new one
        h.update(records[i : i + width])
        hashed.append(h.digest())
    return pa.FixedSizeBinaryArray.from_buffers(pa.binary(KEY), n, [None, pa.py_buffer(b"".join(hashed))])


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
