"""The keys of a sweep's rows, and what they are made of.

A key depends on content, never on order, place or name.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ..core.graph import pack
from ..core.program import design_of
from ..core.scene import Scene
from ..motion.generators import Motion as Generated
from ..motion.recorded import Recording
from ..motion.source import sources_of
from .identity import identity, own_classes
from .measures import Measure
from .plan import Plan
from .rows import Roles, Table, arrow

PACKAGES = ("stimlib", "numpy", "scipy", "llvmlite")
KEY = 16  # bytes
CHUNK = 100_000  # rows that are Python objects at once


def versions() -> dict[str, str]:
    """Return the versions of everything that the bits of a figure may depend on."""
    packages = dict(zip(PACKAGES, map(version, PACKAGES), strict=True))
    return {"python": platform.python_version(), **packages, "source": _source_hash()}


@cache
def _source_hash() -> str:
    """Return a hash of stimlib's source files, which can change within a version."""
    h = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        h.update(path.read_bytes())
    return h.hexdigest()[:16]


def motion_digest(given: Any, name: str, fs: float, seconds: float | None) -> bytes:
    """Return 16 bytes that identify a motion, and the number of samples used.

    A function enters by its name, because its samples are part of each row's content.
    """
    parts = dict(given) if isinstance(given, Mapping) else {"": given}
    text = [float(seconds).hex() if seconds is not None else "own length"]
    text += [f"{key}: {_source(source, name)}" for key, source in sorted(parts.items())]
    return hashlib.sha256("\n".join(text).encode()).digest()[:KEY]


def _source(source: Any, name: str) -> str:
    if isinstance(source, Generated | Recording):
        return repr(source)  # which makes it again; a recording states the sha256 of its file
    if callable(source):
        return f"function {name}"
    values = next(iter(sources_of({"": source}, ("",), 0).values()))
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


def scene_digest(scene: Scene, fs: float, design: list[tuple[Any, Any]] | None = None) -> bytes:
    """Return 32 bytes that identify a scene as it runs.

    They depend on its blocks with their numbers, on their design at this sample rate,
    and on the code of all user-defined blocks.

    Parameters
    ----------
    scene : Scene
    fs : float
        Sample rate in Hz.
    design : list, optional
        Result of ``design_of``, if known.
    """
    h = hashlib.sha256(scene.hash.encode())
    for p, s in design_of(scene.program, fs) if design is None else design:
        h.update(pack(p))
        h.update(pack(s))
    for kind in own_classes(scene):
        h.update(identity(kind, kind.__qualname__).encode())
    return h.digest()


def shared_key(
    make: Any, measures: list[str], fs: float, roles: Roles
) -> tuple[str, dict[str, Any]]:
    """Return the key of a plan, and the facts that enter the key.

    The content of a scene enters the content of each row instead.
    """
    facts = {
        "scene": make.hash if isinstance(make, Scene) else "made",
        "measures": measures,
        "fs": float(fs).hex(),
        "live": sorted(roles.live),
        "arguments": sorted(roles.arguments),
        "versions": versions(),
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest(), facts


def measure_keys(measures: tuple[str | Measure, ...]) -> list[str]:
    """Return the key of each measure: its name, or the hash of its content."""
    return [identity(m, f"measure {m.name}") if isinstance(m, Measure) else m for m in measures]


def code_keys(make: Any, motions: Mapping[str, Any]) -> dict[str, str]:
    """Return the hashes of a factory and of motions that are functions.

    There is no hash if the content cannot be inspected.
    """
    parts = {"scene": make}
    for name, motion in motions.items():
        each = motion if isinstance(motion, Mapping) else {"": motion}
        parts |= {f"motion {name} {key}": m for key, m in each.items()}
    keys = {}
    for name, what in parts.items():
        function = callable(what) and not isinstance(what, Generated | Recording)
        if function or isinstance(what, Scene):
            # of objects of the user's, which need no identity where nothing is kept
            with suppress(Exception):
                keys[" ".join(name.split())] = identity(what, name)
    return keys


def row_keys(plan: Plan, table: Table, digests: Mapping[str, bytes]) -> Any:
    """Return 16 bytes for each row, from the plan, its numbers and its motion.

    They do not depend on the order or number of rows, or on the names of motions, so a
    sweep may grow, and parts may have any size.
    """
    pa = arrow()
    n = table.num_rows
    seeds = table["seed"].to_numpy() if "seed" in table.column_names else np.zeros(n, np.uint64)
    moved = (
        _digests(table["motion"].combine_chunks(), digests)
        if "motion" in table.column_names
        else np.tile(np.frombuffer(digests[""], np.uint8), (n, 1))
    )
    names = sorted((*plan.roles.live, *plan.roles.arguments))
    columns = (_words(table[name].combine_chunks()) for name in names)
    records = np.concatenate([_words(pa.array(seeds)), moved, *columns], axis=1)
    shared = hashlib.blake2b(bytes.fromhex(plan.key), digest_size=KEY)

    def key(record: bytes) -> bytes:
        h = shared.copy()  # half the time of a new one
        h.update(record)
        return h.digest()

    whole = records.view(f"V{records.shape[1]}").ravel()
    chunks = [b"".join(map(key, whole[at : at + CHUNK].tolist())) for at in range(0, n, CHUNK)]
    keys = b"".join(chunks)
    return pa.FixedSizeBinaryArray.from_buffers(pa.binary(KEY), n, [None, pa.py_buffer(keys)])


def _words(column: Any) -> np.ndarray:
    """Return a column as bytes, (rows, 16): type and value, or the digest of a text."""
    kind = str(column.type)
    if kind == "string":
        return _digests(column, None)
    words = np.zeros((len(column), KEY), np.uint8)
    words[:, :8] = np.frombuffer(kind.encode().ljust(8), np.uint8)
    values = column.to_numpy(zero_copy_only=False)
    if kind == "bool":
        values = values.astype(np.uint64)
    words[:, 8:] = np.ascontiguousarray(values).view(np.uint8).reshape(-1, 8)
    return words


def _digests(column: Any, known: Mapping[str, bytes] | None) -> np.ndarray:
    """Return the known digest of each text, or that of its bytes, shape (rows, 16)."""
    coded = column.dictionary_encode()
    texts = coded.dictionary.to_pylist()
    if known is None:
        known = {t: hashlib.sha256(t.encode()).digest()[:KEY] for t in texts}
    values = b"".join(known[t] for t in texts)
    return np.frombuffer(values, np.uint8).reshape(-1, KEY)[coded.indices.to_numpy()]
