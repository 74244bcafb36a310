"""Compiled code on the disk: compiled once per machine, for all processes.

An entry is a file, named by its content: the text, what it is compiled with, the
versions, the processor.  It appears whole, and never changes.  Its machine code is run,
so the folder must be private, and an entry is used only if its SHA-256 is that of what
was written.

It is written by a walk (``walk``), and compiled by LLVM (``machine``).
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import stat
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding

from ...core import maths
from ...core.steps import source
from ...errors import SinkError
from ...system import safe_files
from ...system.cache_folder import folder, lock, open_to_others, temporary
from ...system.progress import announce
from . import known, machine, rows, walk

logger = logging.getLogger(__name__)
# s, for another process to compile an entry, which takes 15 s on two busy cores: it may
# be stopped
WAIT = 300.0
LONG = "runtime_", "pump_"
"""What takes a second to compile, and is missing in an empty cache; a block class takes
a tenth.
"""
PARTS = (
    "../walk machine values walk known rows enabled instructions lanes kernels vectors segments"
).split()
"""Files beside this one that are compiled into entries, or say how."""


class Code(NamedTuple):
    """A compiled text: where it is kept, and the address of each of its functions."""

    name: str
    addresses: Mapping[str, int]


_loaded: dict[str, Code] = {}


# Entries ------------------------------------------------------------------------------
@cache
def _salt() -> str:
    # the texts of our own files, not a version: an edit of the compiler must compile
    # again
    texts = [(Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8") for name in PARTS]
    # they are compiled into the runtime, which only names their classes
    operations = [source(cls.step) for cls in rows.OPERATIONS if cls.step]
    # code for another processor may not run here, and homes are shared between machines
    host = llvmlite.binding.get_host_cpu_name(), machine.FEATURES, machine.CHOICES
    texts += [Path(maths.__file__).read_text(encoding="utf-8")]
    versions = llvmlite.__version__, sys.version_info[:2]
    return _sum("".join([*texts, *operations, repr((host, versions))]).encode())


def _sums(text: str) -> str:
    return _sum((text + _salt()).encode())


def load(text: str, stem: str, make: Callable[[], walk.Intermediate] | None = None) -> Code:
    """Return the code of a source, from the cache or newly compiled.

    Any number of threads and processes may call it at once.

    Parameters
    ----------
    text : str
        All that decides what is compiled: a source file, without ``make``.
    stem : str
        How the name of its entry begins.
    make : callable, optional
        Gives it as LLVM's text.

    Raises
    ------
    SinkError
        Not even a temporary folder can be written.
    """
    name = f"{stem}_{_sums(text)[:20]}"
    # a fork takes this lock first, so a child never finds it taken: see cache_folder
    with lock:
        if name not in _loaded:
            try:
                # once per process, and never again from the disk: what is loaded stays
                _loaded[name] = _load(folder() / name, text, make)
            except OSError as error:  # full or gone in the middle
                # code goes on without a cache: from here on the folder is a temporary
                # one
                temporary(folder(), error)
                try:
                    _loaded[name] = _load(folder() / name, text, make)
                except OSError as again:
                    raise SinkError(
                        f"cannot compile into {folder()}: {again.strerror or again}"
                    ) from again
        return _loaded[name]


def _load(entry: Path, text: str, make: Callable[[], walk.Intermediate] | None) -> Code:
    own_hash = _sums(text)
    if (code := _kept(entry, own_hash)) is None:
        # said before the wait, and only where it is long enough to wonder
        if entry.name.startswith(LONG):
            for tell in announce:
                tell("compiling for this machine, once: about two seconds")
        # looked for again in one's turn: another process may have written it meanwhile
        with _turn(entry, text):
            if (code := _kept(entry, own_hash)) is None:
                began = time.perf_counter()
                _publish(entry, text, make)
                seconds = time.perf_counter() - began
                logger.info(
                    "cache miss: %s compiled in %.2f s, into %s", entry.name, seconds, entry.parent
                )
                # read back, not kept from the compiler: what runs is what was checked
                code = _kept(entry, own_hash)
    if code is None:
        raise OSError(f"what was written to {entry} is not what is there")
    return code


def _kept(entry: Path, own_hash: str) -> Code | None:
    """Return the code of an entry, or None unless it is intact and can be used here."""
    if (found := _sound(entry, own_hash)) is None:
        return None
    header, code_bytes = found
    try:
        # a kernel or function of C that this process lacks
        if machine.missing(header["calls"]):
            return None
        code = Code(entry.name, machine.addresses(code_bytes, header["names"]))
    except (LookupError, RuntimeError, TypeError):  # sums that fit, and code that does not
        return None
    logger.debug("cache hit: %s in %s", entry.name, entry.parent)
    return code


def _sound(entry: Path, own_hash: str) -> tuple[dict[str, Any], bytes] | None:
    """Return the parts of an entry, or None unless it is intact and made of this."""
    try:
        # not stat: a link could lead out of the private folder
        info = os.lstat(entry)
        if not stat.S_ISREG(info.st_mode) or open_to_others(info):
            return None
        # a line of JSON, then object code: whoever looks for a fault can read the first
        # limits are for the files of others; this one is in our folder
        with open(safe_files.opened(entry), "rb") as f:
            line, _, code_bytes = f.read(2**28).partition(b"\n")
        header = json.loads(line)
        # the sum covers the header as well; the hash of the text tells an entry that
        # somebody renamed
        wanted = header.pop("sha256")
        sound = wanted == _sum(json.dumps(header).encode() + code_bytes)
        return (header, code_bytes) if header["of"] == own_hash and sound else None
    except (OSError, SinkError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _publish(entry: Path, text: str, make: Callable[[], walk.Intermediate] | None) -> None:
    """Compile an entry and move it into the cache, whatever but a folder is there."""
    made = make() if make else walk.of_module(text, entry.name, known.TWINS)
    # a text without make is a file of ours: the runtime or a part of it
    code_bytes, calls = machine.machine_code(made.llvm, ours=make is not None)
    header = {"of": _sums(text), "names": made.names, "calls": calls}
    line = json.dumps(header | {"sha256": _sum(json.dumps(header).encode() + code_bytes)}).encode()
    if not entry.is_file():  # a pipe or a device, which publish replaces for nobody
        with suppress(OSError):
            entry.unlink()
    try:
        safe_files.publish(entry, line + b"\n" + code_bytes)
    except SinkError as e:
        raise e.__cause__ if isinstance(e.__cause__, OSError) else OSError(str(e)) from None
    entry.chmod(0o600)  # whatever the umask is


@contextmanager
def _turn(entry: Path, text: str) -> Iterator[None]:
    """Lock an entry for compiling, or wait until another process has compiled it.

    In the second case the entry is valid afterwards.

    The system frees the lock of a process that ends, however it ends. If the file
    system has no locks, or the other process takes longer than WAIT, both compile, and
    one result is kept. Only the process that holds the lock removes the lock file.
    """
    lock_file, latest = entry.with_name(f"{entry.name}.lock"), time.monotonic() + WAIT
    with ExitStack() as stack:
        # a lock that is taken shows that somebody compiles; the entry, that it is done
        while not _sound(entry, _sums(text)) and time.monotonic() < latest:
            if safe_files.taken(stack, lock_file):
                break
            stack.close()
            time.sleep(0.02)
        yield


def _sum(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
