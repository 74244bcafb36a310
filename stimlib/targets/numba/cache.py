"""Compiled segments on the disk: compiled once per machine, for all processes.

An entry is a folder, named by its content: the text, the runtime, the versions, the
processor.  It is compiled in a folder of its own, put on the disk with the SHA-256 of
each of its files, and then renamed: so it appears whole, and never changes. numba
unpickles and runs what it finds there.  So the cache must be private, and numba sees
nothing that is not what was written.
"""

from __future__ import annotations

import gc
import hashlib
import inspect
import json
import logging
import os
import re
import shutil
import stat
import sys
import tempfile
import time
import types
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding
import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys

from ...core import maths
from ...core.steps import source
from ...errors import SinkError
from ...system import safe_files
from ...system.cache_folder import folder, lock, open_to_others, temporary
from ...system.progress import announce, counted
from . import intrinsics, kernels, vectors

logger = logging.getLogger(__name__)
SUMS = "sha256.json"
# s, for another process to compile an entry, which takes 15 s on two busy cores: it may
# be stopped
WAIT = 300.0
LONG = "runtime_", "pump_"
"""What takes a second to compile, and is missing in an empty cache; a block class takes
a tenth.
"""

LEFT = re.compile(r"\w+_[0-9a-f]{20}\.\w{8}\.tmp")  # a folder that tempfile.mkdtemp made here
_loaded: dict[str, types.ModuleType] = {}  # complete ones only


# Entries ------------------------------------------------------------------------------
@cache
def _salt() -> str:
    parts = ("runtime.py", "slow_modes.py", "stretches.py")
    runtime = "".join(Path(__file__).with_name(name).read_text() for name in parts)
    config: Any = numba.config
    host = llvmlite.binding.get_host_cpu_name(), config.CPU_NAME, kernels.FEATURES
    flags = (
        numba.__version__,
        llvmlite.__version__,
        sys.version_info[:2],
        config.BOUNDSCHECK,
        config.OPT,
        *host,
    )
    operations = "".join(source(cls.step) for cls in vectors.OPERATIONS if cls.step)
    return (
        "".join(map(inspect.getsource, (kernels, vectors, intrinsics, maths)))
        + runtime
        + operations
        + repr(flags)
    )


def _name(text: str, stem: str) -> str:
    return f"{stem}_{_sum((text + _salt()).encode())[:20]}"


def expect(pieces: Iterable[tuple[str, str]]) -> None:
    """Report how many lines have to be compiled before pieces can be loaded.

    Pieces are arguments of ``load``. Nothing is done unless somebody counts.
    """
    for tell in counted:
        new = {
            name: text
            for text, stem in pieces
            if (name := _name(text, stem)) not in _loaded and not (folder() / name).exists()
        }
        tell("".join(new.values()).count("\n"), 0)


def load(text: str, stem: str) -> types.ModuleType:
    """Import generated source, from the cache or newly compiled.

    Any number of threads and processes may call it at once.

    Raises
    ------
    SinkError
        Not even a temporary folder can be written.
    """
    name = _name(text, stem)
    with lock:
        if name not in _loaded:
            try:
                _loaded[name] = _load(folder() / name, text)
            except OSError as e:  # full or gone in the middle
                temporary(folder(), e)
                try:
                    _loaded[name] = _load(folder() / name, text)
                except OSError as again:
                    raise SinkError(
                        f"cannot compile into {folder()}: {again.strerror or again}"
                    ) from again
        return _loaded[name]


def _load(place: Path, text: str, alone: bool = False) -> types.ModuleType:
    if _sound(place, text):
        with suppress(Exception), _no_compiler():  # numba lets whatever unpickling raises through
            module = _execute(place, text)
            logger.debug("cache hit: %s in %s", place.name, place.parent)
            return module
    if not alone:
        if place.name.startswith(LONG):
            for tell in announce:
                tell("compiling for this machine, once: about ten seconds")
        with _turn(place, text):
            return _load(place, text, alone=True)
    began = time.perf_counter()
    _remove(place)
    part = Path(tempfile.mkdtemp(prefix=f"{place.name}.", suffix=".tmp", dir=place.parent))
    try:
        (part / f"{place.name}.py").write_text(text)
        module = _compiled(part, text, place.name)
        _publish(part, place)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    logger.info(
        "cache miss: %s compiled in %.2f s, into %s",
        place.name,
        time.perf_counter() - began,
        place.parent,
    )
    return module


@contextmanager
def _turn(place: Path, text: str) -> Iterator[None]:
    """Lock an entry for compiling, or wait until another process has compiled it.

    In the second case the entry is valid afterwards.

    The system frees the lock of a process that ends, however it ends. If the file
    system has no locks, or the other process takes longer than WAIT, both compile, and
    one result is kept. Only the process that holds the lock removes the lock file.
    """
    at, until = place.with_name(f"{place.name}.lock"), time.monotonic() + WAIT
    with ExitStack() as stack:
        while not _sound(place, text) and time.monotonic() < until:
            if safe_files.taken(stack, at):
                stack.callback(safe_files.remove, at)
                break
            stack.close()
            time.sleep(0.02)
        yield
    for tell in counted:
        tell(0, text.count("\n"))


def _execute(place: Path, text: str, name: str = "") -> types.ModuleType:
    """Run source as a module whose file lies in a folder.

    numba stores what it compiles next to that file.
    """
    name = name or place.name
    path = str(place / f"{name}.py")
    module = types.ModuleType(name)
    module.__file__ = path
    config: Any = numba.config
    elsewhere, config.CACHE_DIR = config.CACHE_DIR, ""
    sys.modules[name] = module  # for numba, which looks it up
    try:
        exec(compile(text, path, "exec", dont_inherit=True), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        config.CACHE_DIR = elsewhere
    return module


def _compiled(place: Path, text: str, name: str) -> types.ModuleType:
    """Compile source with as little of numba as it needs.

    numba's implementations of arithmetic, tuples and arrays suffice for what stimlib
    itself compiles; importing the others takes half a second. Python's collector of
    cycles would look at all of them again and again.
    """
    context: Any = cpu_target.target_context
    made: Any = context.codegen()
    collects = gc.isenabled()
    gc.disable()
    try:
        options = _choices() if "def _sl_segment(" in text else global_compiler_lock
        with suppress(Exception), options:
            context.load_additional_registries = partial(_few, context)
            made._library_class = _Library
            compiler: Any = Compiler
            whole, compiler.define_pipelines = Compiler.define_pipelines, _few_passes
            try:
                return _execute(place, text, name)
            finally:
                compiler.define_pipelines = whole
                del context.load_additional_registries, made._library_class
        with _choices():  # a step of a user may need all of numba
            return _execute(place, text, name)
    finally:
        if collects:
            gc.enable()


@contextmanager
def _choices() -> Iterator[None]:
    """Compile segments with our options of LLVM, while nobody else compiles.

    The runtime gains nothing from them, and would take a quarter longer to compile.
    """
    with global_compiler_lock:
        try:
            _choose(0)
            yield
        finally:
            _choose(1)


def _choose(turn: int) -> None:
    """Set the options of LLVM for our code (0), or for others (1)."""
    for name, values in kernels.CHOICES.items():
        llvmlite.binding.set_option("", f"-{name}={values[turn]}")


class _Library(JITCodeLibrary):
    """Machine code that is optimised once.

    numba does it three times, for the sake of reference counts, which segments lack.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


# passes of numba for what steps have not: closures, comprehensions, branches on None,
# expressions of whole arrays
UNUSED = {
    "inline_closure_likes",
    "rewrite_semantic_constants",
    "dead_branch_prune",
    "inline_overloads",
    "nopython_rewrites",
}


def _few_passes(compiler: Any) -> list[Any]:
    """Return the compiler passes of numba that stimlib's own steps need."""
    passes = DefaultPassBuilder.define_nopython_pipeline(compiler.state)
    passes.passes = [one for one in passes.passes if one[0]._name not in UNUSED]
    return [passes]


def _few(context: Any) -> None:
    """Register the implementations that stimlib's own steps need."""
    from numba.cpython import mathimpl, numbers, rangeobj, slicing, tupleobj  # noqa: F401
    from numba.np import arrayobj, npyimpl  # noqa: F401

    rtsys.initialize(context)
    context.install_registry(mathimpl.registry)
    context.install_registry(npyimpl.registry)


@contextmanager
def _no_compiler() -> Iterator[None]:
    """Skip numba's registrations for Python, numpy and scipy in this context.

    Loading compiled code does not need them, and they would take most of the start-up
    time.

    Later compilations let numba load them as usual.
    """
    context: Any = cpu_target.target_context
    with global_compiler_lock:  # nobody compiles meanwhile
        rtsys.initialize(context)
        context.refresh = lambda: None
        try:
            yield
        finally:
            del context.refresh


def _publish(part: Path, place: Path) -> None:
    """Move an entry into its place, unless another process was faster."""
    sums = {
        str(path.relative_to(part)): _sum(path.read_bytes())
        for path in sorted(part.rglob("*"))
        if path.is_file()
    }
    # or numba has kept it elsewhere, where its folder cannot be written
    if any(name.endswith(".nbc") for name in sums):
        safe_files.publish(part / SUMS, json.dumps(sums))
        for path in part.rglob("*"):
            path.chmod(0o700 if path.is_dir() else 0o600)
            safe_files.settle(path)
        try:
            os.rename(part, place)
        except OSError:
            if not place.is_dir():
                raise
        safe_files.settle(place.parent)
        _sweep(place.parent)


def _sweep(folder: Path) -> None:
    """Remove what killed processes left behind.

    These are folders of ours in which nobody has written for a day.
    """
    for part in folder.glob("*.tmp"):
        with suppress(OSError):  # another process was faster
            info = os.lstat(part)
            ours = stat.S_ISDIR(info.st_mode) and info.st_uid == getattr(os, "geteuid", lambda: 0)()
            if ours and LEFT.fullmatch(part.name):
                if (
                    max(os.lstat(p).st_mtime for p in (part, *part.rglob("*")))
                    < time.time() - 86400
                ):
                    shutil.rmtree(part, ignore_errors=True)  # it follows no link


def _sound(place: Path, text: str) -> bool:
    """Return whether an entry is the intact result of compiling this source."""
    try:
        info = os.lstat(place)
        if not stat.S_ISDIR(info.st_mode) or open_to_others(info):
            return False
        sums = json.loads(safe_files.read(place / SUMS, "sidecar_bytes"))
        source = safe_files.read(place / f"{place.name}.py", "sidecar_bytes")
        sources = sums.pop(f"{place.name}.py") == _sum(source) and source == text.encode()
        return (
            sources
            and bool(sums)
            and all(
                _sum(safe_files.read(place / name, "sidecar_bytes")) == s
                for name, s in sums.items()
            )
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False


def _remove(place: Path) -> None:
    """Remove an entry in one step.

    Another process may be about to read it.
    """
    if os.path.lexists(place):
        aside = Path(tempfile.mkdtemp(prefix=f"{place.name}.", suffix=".tmp", dir=place.parent))
        with suppress(FileNotFoundError):  # another process was faster
            os.rename(place, aside / "damaged")
        shutil.rmtree(aside, ignore_errors=True)


def _sum(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
