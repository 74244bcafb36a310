"""The folder of a sweep: atomically written Parquet parts, and a sidecar."""

from __future__ import annotations

import hashlib
import json
import os
import time
import warnings
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Self

from ..errors import BadValue, SinkError, StimlibError, outside
from ..system import safe_files
from .keys import KEY
from .rows import Table, arrow

SIDECAR = "_sweep.json"  # readers of a folder of Parquet leave out names that begin so
VERSION = 2
# s between parts: finished work that a killed run can lose, besides the second of a job
EVERY = 1.0
LARGEST = 200_000  # rows of a part
SMALL = 10_000  # rows of a part that may be merged with others
MANY = 16  # small parts, which are then merged


class Store:
    """The stored parts of a sweep, to which new parts can be added.

    Without a folder, the parts are kept in memory.

    Parameters
    ----------
    folder : path or None
        The folder, created if missing.
    facts : dict
        Everything that the rows depend on, with ``key``; a folder belongs to one key.
    about : dict
        Further contents of the sidecar: units and motions.
    dry : bool
        Only read.

    Raises
    ------
    SinkError
        The folder cannot be created or written, contains something else, or another
        sweep is writing to it.
    BadValue
        The folder has another sweep; the message names the differences.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str] | None,
        facts: Mapping[str, Any],
        about: Mapping[str, Any],
        dry: bool = False,
    ):
        self.dry, self.rows = dry, 0
        self.folder = None if folder is None else safe_files.make_folder(folder)
        self.tables: list[Table] = []
        self._waiting: list[Table] = []
        self._written = time.monotonic()
        self._facts, self._about = dict(facts), dict(about)
        self._lock = -1

    def __enter__(self) -> Self:
        if self.folder is not None:
            busy = (
                f"another sweep is writing into {self.folder}: wait for its end, or name another"
                " folder"
            )
            self._lock = safe_files.lock(self.folder, busy)
            try:
                self._open(self.folder)
            except BaseException:
                os.close(self._lock)
                raise
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.flush()
        finally:
            if self._lock >= 0:
                os.close(self._lock)

    def _open(self, folder: Path) -> None:
        sidecar = folder / SIDECAR
        known = self._same(sidecar) if sidecar.exists() else {}
        other = [p.name for p in folder.iterdir() if not p.name.endswith(".part")]
        if other and not known:
            raise SinkError(
                f"{folder} has {min(other)} and no {SIDECAR}: it is no folder of a sweep; name an"
                " empty one"
            )
        names = ["key", "content", *self._about["units"], "fault", "error"]
        paths = sorted(folder.glob("part-*.parquet"))
        with ThreadPoolExecutor() as threads:
            parts = dict(zip(paths, threads.map(partial(_part, names=names), paths), strict=True))
        self.tables += [table for table in parts.values() if table is not None]
        if self.dry:
            return
        motions = known.get("motion", {}) | self._about["motion"]
        told = {"stimlib_sweep": VERSION, **self._facts, **self._about, "motion": motions}
        if known != told:
            safe_files.publish(sidecar, json.dumps(told, indent=1) + "\n")
        for path, table in parts.items():
            if table is None:
                aside = path.with_name(f"_{path.stem}.damaged")
                os.replace(path, aside)
                text = f"{path.name} is damaged: it is {aside.name} now, and its rows run again"
                warnings.warn(text, RuntimeWarning, stacklevel=outside())
        for left in folder.glob("part-*.part"):  # of a run that was killed
            left.unlink(missing_ok=True)
        self._merge(parts)

    def _merge(self, parts: Mapping[Path, Table | None]) -> None:
        """Replace many small parts with the same columns by one.

        After a kill between the two steps rows are there twice, until they are merged.
        """
        small: dict[str, list[Path]] = {}
        for path, table in parts.items():
            if table is not None and table.num_rows < SMALL:
                small.setdefault(table.schema.to_string(show_field_metadata=True), []).append(path)
        for paths in small.values():
            if len(paths) >= MANY:
                table = arrow().concat_tables([parts[path] for path in paths])
                table = table.append_column("at", arrow().array(range(table.num_rows)))
                once = table.group_by(["key", "content", "error"]).aggregate([("at", "min")])
                merged = self._publish(table.drop_columns("at").take(once["at_min"].sort()))
                for path in paths:
                    if path != merged:
                        path.unlink(missing_ok=True)

    def _same(self, sidecar: Path) -> dict[str, Any]:
        try:
            known = json.loads(safe_files.read(sidecar, "sidecar_bytes"))
            key, version, _ = known["key"], known["stimlib_sweep"], dict(known["motion"])
        except (ValueError, KeyError, TypeError, RecursionError) as e:
            if isinstance(e, StimlibError):
                raise
            raise SinkError(
                f"{sidecar} is damaged ({type(e).__name__}): name another folder"
            ) from None
        if version != VERSION:
            raise SinkError(
                f"{sidecar} is of version {version!r:.40}, this stimlib reads {VERSION}: update"
                " stimlib"
            )
        if key != self._facts["key"]:
            other = [n for n, v in self._facts.items() if n != "key" and known.get(n) != v]
            raise BadValue(
                f"{sidecar.parent} has another sweep, with other {', '.join(other) or 'facts'}:"
                " name another folder"
            )
        return known

    def done(self, names: Sequence[str]) -> Table:
        """Return keys, contents and selected columns of all stored rows.

        The newest rows come first, and failed rows come last.
        """
        pa, pc = arrow(), arrow("pyarrow.compute")
        kinds = dict.fromkeys(("key", "content"), pa.binary(KEY)) | dict.fromkeys(names, pa.null())
        empty = pa.table({name: pa.array([], kind) for name, kind in kinds.items()})
        tables = [t.select(empty.column_names) for t in reversed(self.tables)]
        table = pa.concat_tables(tables, promote_options="permissive") if tables else empty
        if table["error"].null_count < table.num_rows:
            failed = pc.is_valid(table["error"])
            table = pa.concat_tables([table.filter(pc.invert(failed)), table.filter(failed)])
        return table.combine_chunks()

    def add(self, table: Table) -> None:
        """Store rows with their keys; a part is written every few seconds."""
        self.tables.append(table)
        self.rows += table.num_rows
        if self.folder is None or self.dry:
            return
        self._waiting.append(table)
        rows = sum(t.num_rows for t in self._waiting)
        if rows >= LARGEST or time.monotonic() > self._written + EVERY:
            self.flush()

    def flush(self) -> None:
        """Write to disk the rows that are still in memory."""
        if self._waiting and self.folder is not None:
            self._publish(arrow().concat_tables(self._waiting))
            self._waiting.clear()
        self._written = time.monotonic()

    def _publish(self, table: Table) -> Path:
        """Write a part, and return its path."""
        assert self.folder is not None
        sink = arrow().BufferOutputStream()
        texts = [f.name for f in table.schema if f.type == arrow().string()]
        arrow("pyarrow.parquet").write_table(
            table.combine_chunks(), sink, compression="zstd", use_dictionary=texts
        )
        data = sink.getvalue().to_pybytes()
        path = self.folder / _name(data)
        safe_files.publish(path, data)
        return path


def _name(data: bytes) -> str:
    """Return the name of a part, a hash of its content that reveals damage."""
    return f"part-{hashlib.sha256(data).hexdigest()[:32]}.parquet"


def _part(path: Path, names: Collection[str]) -> Table | None:
    """Return selected columns of a part, or None if it is damaged or unknown."""
    data = safe_files.read(path, "audio_bytes")
    if _name(data) != path.name:
        return None
    try:
        table = arrow("pyarrow.parquet").read_table(arrow().BufferReader(data))
    except (arrow().ArrowException, OSError):
        return None
    return table if set(names) <= set(table.column_names) else None
