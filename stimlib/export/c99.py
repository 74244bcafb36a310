"""Export of a scene as plain C99, whose samples have the same bits."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from ..core.clocks import ROOT
from ..core.program import rate
from ..core.scene import Scene
from ..errors import BadValue, MissingPackage, SceneError, SinkError, public
from ..motion.source import frames_of, positions, sources_of
from ..run.driver import samples
from ..run.processor import Change, Processor, compile
from ..run.safety import GAIN, Safety, protect
from ..system.limits import limits
from ..system.safe_files import make_folder, publish_all
from .program import Writer

MOST_ERROR = 1e-3
"""Largest error of float32 that is exported, relative to the peak of an output."""

NAME = re.compile(r"[a-z][a-z0-9_]{0,40}")
RAMP = 0.01  # seconds, of the parameters in the self test

TAKEN = frozenset(
    # headers of C23 and of POSIX: with -I, the compiler would read ours in their place
    "assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal"
    " stdalign stdarg stdatomic stdbit stdbool stdckdint stddef stdint stdio stdlib"
    " stdnoreturn string tgmath threads time uchar wchar wctype aio alloca byteswap cpio"
    " dirent dlfcn elf endian err error execinfo fcntl features fmtmsg fnmatch ftw getopt glob"
    " grp iconv ifaddrs io langinfo libgen libintl malloc memory monetary mqueue ndbm netdb"
    " nl_types obstack paths poll process pthread pwd regex resolv sched search semaphore"
    " shadow spawn strings stropts syslog tar termios ucontext ulimit unistd utime utmp utmpx"
    " values varargs wait windows wordexp"
    # ours, what float32 replaces, libraries, targets of CMake and devices of Windows
    " st double stimlib c m test all help clean install package con aux nul prn".split()
) | {f"{port}{k}" for port in ("com", "lpt") for k in range(1, 10)}
"""Names that C, POSIX, CMake or Windows have for something else."""
# of the header, beside those of parameters
MACROS = ("export", "fs", "inputs", "outputs", "fault", "tile")
MARK = b"xported by stimlib"  # in each file

CMAKE = """\
# Exported by stimlib. cmake -B build && cmake --build build && ctest --test-dir build
cmake_minimum_required(VERSION 3.10)
project({name} C)
set(CMAKE_C_STANDARD 99)
set(CMAKE_C_EXTENSIONS OFF)
add_library({name} {name}.c)
target_include_directories({name} PUBLIC .)
add_executable({name}_test {name}_test.c)
target_link_libraries({name}_test {name})
if(UNIX)
  target_link_libraries({name} m)
endif()
enable_testing()
add_test({name} {name}_test)
"""
README = """\
# {name}

A stimulus at {fs:g} Hz, exported by stimlib {version} as C99: `{name}.h`, `{name}.c`. The state
takes about {size} bytes. Nothing is allocated and nothing is global, so several states can run
beside each other. The comment in `{name}.h` lists inputs, outputs and parameters with their units.

```c
static {name}_state m;
{name}_init(&m);
{name}_process(&m, in, out, n); /* in[k][i]: sample i of input k; any n */
```

Between two calls, `{name}_set(&m, parameter, value, samples)` moves a parameter along a straight
line, within so many samples; `{name}.h` has a constant for each parameter.

`{name}_test.c` compares {samples} samples with those of {of}, bit by bit. Build and run it once
with the compiler and the options of your program:

    cc -std=c99 -O2 {name}.c {name}_test.c -o {name}_test -lm && ./{name}_test

It must print "0 of {samples} samples differ". Options that let a compiler change results, such as
-ffast-math and -ffp-contract=fast, break this; -ffast-math is refused.
"""
SINGLE = """
This export computes in float32, as `{name}.h` declares. Its samples differ from those of stimlib by
the errors below, of the self test's motion, which its own C had on the machine that made it:

{errors}
exp, log, sin, cos and tanh are computed in double precision, also where that is done in software.
"""


INCLUDE = str(Path(__file__).parent)
"""Folder of ``stimlib.h``, for the -I of a compiler."""


@dataclass(frozen=True)
class Exported:
    """What ``export_c`` wrote.

    Attributes
    ----------
    files : tuple of Path
        Header, source, self test, CMakeLists.txt and README.md.
    state_bytes : int
        Approximate size of the state.
    samples : int
        How many samples the self test compares.
    errors : dict of str to (float, float, float)
        For float32: root mean square and largest error of each output, and its peak, in
        the output's unit.
    """

    files: tuple[Path, ...]
    state_bytes: int
    samples: int
    errors: dict[str, tuple[float, float, float]] = field(default_factory=dict)


@public
def export_c(
    scene: Scene,
    fs: float,
    folder: str | Path,
    motion: Mapping[str, Any] | None = None,
    name: str = "stimulus",
    seconds: float = 0.1,
    params: Mapping[str, float] | None = None,
    seed: int = 0,
    tile: int = 64,
    safety: Safety | None = None,
    precision: Literal["float64", "float32"] = "float64",
) -> Exported:
    """Write a scene at one sample rate as C99, with a self test of equal samples.

    Every block, parameters with their ramps, ``enabled``, loops, segments, noise and
    the guard on each output are exported. The samples have the bits of
    ``Processor.process``, for any cut into calls.

    Parameters
    ----------
    scene : Scene
    fs : float
        Sample rate in Hz.
    folder : path
        Made if missing. Files of an earlier export are replaced, and no others.
    motion : mapping of str to array or callable, optional
        Motion of every input in the self test, as of ``render``.
    name : str
        Prefix of all names in C: lower-case letters, digits and underscores.
    seconds : float
        Length of the self test. After a third of it every parameter falls by 10 %,
        within 10 ms.
    params : mapping of str to float, optional
        Values of parameters at sample 0.
    seed : int
        Of the run, and so of its noise: it is fixed in the exported state.
    tile : int
        Samples that a block computes at a time, 1 to 64: less memory, or less time.
    safety : Safety, optional
        Limits of every output, as ``protect`` makes them for a device; the outputs are
        0 until the program sets the parameter ``sink_gain`` to 1, and the counts of
        limited samples are fields of the state, named in the header. Without it the
        outputs have no limits.
    precision : {"float64", "float32"}
        "float32" is for processors with single precision only. Design numbers are
        rounded once; phases, counters and seeds stay whole numbers. The exported C is
        compiled and run here, by the compiler of the environment variable CC or one
        that is installed: its error against float64 is in the header, and the self test
        compares with its samples.

    Returns
    -------
    Exported

    Raises
    ------
    BadValue
        A name that C does not take, or parameters whose macros would be the same; fs,
        seconds, tile or a parameter out of range; a motion that is missing or short.
    SceneError
        A block with a part that has no form in C, or in float32; the message names file
        and line, or the block whose error in float32 is above 1e-3 of its peak.
    MissingPackage
        No C compiler is there to measure the error of float32.
    UnitError, UnknownName
        Limits that do not fit the outputs.
    SinkError
        The folder cannot be written, or has a file of this name from elsewhere.

    Examples
    --------
    >>> import tempfile, numpy as np, stimlib
    >>> from stimlib.export import export_c
    >>> folder = tempfile.mkdtemp()
    >>> made = export_c(stimlib.scenes.wall(), 8000, folder, {"x": 0.01 * np.ones(800)})
    >>> [path.name for path in made.files[:3]]
    ['stimulus.h', 'stimulus.c', 'stimulus_test.c']
    """
    if not NAME.fullmatch(name):
        raise BadValue(
            f"export_c: name = {name!r}; give lower-case letters, digits and underscores, such as"
            " 'squeeze'"
        )
    if name in TAKEN:
        raise BadValue(
            f"export_c: name = {name!r} is taken: C, POSIX, CMake or Windows have a header, library"
            f" or target of this name; give another, such as {name + '_stimulus'!r}"
        )
    if not 1 <= tile <= 64:
        raise BadValue(f"export_c: tile = {tile} must be from 1 to 64")
    fs = rate(fs)
    proc = compile(protect(scene, safety) if safety else scene, fs, seed=seed)
    macros = list(MACROS)
    for parameter in proc.params:
        if parameter.upper() in (m.upper() for m in macros):
            raise BadValue(
                f"export_c: parameter {parameter!r}: its macro {name}_{parameter}, in capitals,"
                " is there already; rename the parameter"
            )
        macros.append(parameter)
    for parameter, value in (params or {}).items():
        proc.set(parameter, value, ramp=0.0)
    proc.state = proc.state  # takes the parameters in
    motion = dict(motion or {})
    if missing := [n for n in proc.inputs if n not in motion]:
        raise BadValue(f"export_c: no motion for {', '.join(missing)}; the self test needs one")
    n = max(3, frames_of(seconds, fs))
    for one, source in motion.items():
        if not callable(source) and np.ndim(source) and len(source) < n:
            raise BadValue(
                f"export_c: motion of {one} has {len(source)} samples and the self test {n}; give"
                f" more, or seconds={len(source) / fs:g}"
            )
    limits.check("render_bytes", 8 * n * len(proc.outputs), "export_c: bytes of the self test")
    x = positions(sources_of(motion, proc.inputs, n), 0, n, fs)
    single, cut, first = precision == "float32", n // 3, proc.params
    writer = Writer(proc, name, tile, single)
    fade = [Change(0, GAIN, 1.0, safety.samples(fs) / fs)] if safety else []
    changes = fade + [
        Change(cut, p, 0.9 * v, RAMP)  # a higher frequency may not fit below fs/2
        for p, v in proc.params.items()
        if not (fade and p == GAIN)
    ]
    y = wanted = samples(proc, x, n, changes)
    errors: dict[str, tuple[float, float, float]] = {}
    if single:
        wanted = run_here(writer, x, y.shape, changes)
        errors = dict(zip(proc.outputs, differences(wanted, y), strict=True))
    said = []
    for output, (rms, most, peak) in errors.items():
        if not most <= MOST_ERROR * peak:
            raise SceneError(
                f"export_c: {output} differs by {most:.2g} from float64 in float32, more than"
                f" {MOST_ERROR:g} of its peak {peak:.2g}, first after"
                f" {first_above(proc, x, changes, first, seed)}; export it in float64"
            )
        said.append(
            f"{output}: rms {rms:.2g}, at most {most:.2g} {proc.units[output]}, which is"
            f" {most / (peak or 1.0):.2g} of its peak {peak:.3g}\n"
        )
    from ..version import __version__

    of = "this C on the machine that exported it" if single else "stimlib"
    facts = {"name": name, "fs": fs, "size": writer.size, "samples": y.size, "of": of}
    more = SINGLE.format(name=name, errors="".join(f"- {row}" for row in said)) * single
    notes = "".join(f"   error of float32 in {row}" for row in said)
    texts = writer.files(x, wanted, changes, notes) | {
        "CMakeLists.txt": CMAKE.format(**facts),
        "README.md": README.format(version=__version__, **facts) + more,
    }
    into = make_folder(folder)
    files: dict[str | os.PathLike[str], str | bytes] = {into / f: t for f, t in texts.items()}
    for path in filter(os.path.isfile, files):
        with open(path, "rb") as f:
            if MARK not in f.read(1000):
                raise SinkError(
                    f"{path} is there already, from elsewhere; give another folder or name"
                )
    publish_all(files)
    return Exported(tuple(map(Path, files)), writer.size, y.size, errors)


def run_here(
    writer: Writer, x: np.ndarray, shape: tuple[int, ...], changes: Sequence[Change]
) -> np.ndarray:
    """Return the samples of an export, compiled and run on this machine."""
    known = (os.environ.get("CC", "").split(), ["cc"], ["gcc"], ["clang"])
    compiler = next((words for words in known if words and shutil.which(words[0])), None)
    if compiler is None:
        raise MissingPackage(
            "export_c: precision='float32' needs a C compiler here, to measure its error; install"
            " gcc or clang, or name a compiler in the environment variable CC"
        )
    with TemporaryDirectory() as folder:
        for file, text in writer.files(x, np.zeros(shape), changes).items():
            Path(folder, file).write_text(text, encoding="utf-8")
        words = f"-std=c99 -O1 -DSTIM_PRINT {writer.name}.c {writer.name}_test.c -o run.exe".split()
        words = [*compiler, *words, *["-lm"] * (os.name != "nt")]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            raise SinkError(f"export_c: {compiler[0]} does not compile the C: {done.stderr:.300}")
        rows = subprocess.run(
            [Path(folder, "run.exe")], capture_output=True, text=True
        ).stdout.splitlines()
    bits = [int(row[6:], 16) for row in rows if row.startswith("bits: ")]
    return np.array(bits, np.uint32).view(np.float32).astype(float).reshape(shape)


def differences(narrow: np.ndarray, y: np.ndarray) -> list[tuple[float, float, float]]:
    """Return rms and largest difference of each row, and the peak of y."""
    e = narrow - y
    rows = zip(np.sqrt(np.mean(e * e, 1)), np.abs(e).max(1), np.abs(y).max(1), strict=True)
    return [(float(rms), float(most), float(peak)) for rms, most, peak in rows]


def first_above(
    proc: Processor, x: np.ndarray, changes: list[Change], params: Mapping[str, float], seed: int
) -> str:
    """Return the first block whose signal in float32 differs by more than allowed."""
    blocks = {
        f"block_{i}": q.block
        for i, q in enumerate(proc.program.instances)
        if q.clock <= ROOT
        and (q.kind == "pick" or (q.kind == "block" and not q.block.definition.outputs))
    }
    each = compile(Scene(blocks), proc.fs, seed=seed)
    changes = [Change(0, p, v, 0.0) for p, v in params.items()] + changes
    narrow = run_here(Writer(each, "blocks", 64, True), x, (len(blocks), x.shape[1]), changes)
    found = differences(narrow, samples(each, x, x.shape[1], changes))
    far = (
        f"{b!r:.80}"
        for b, e in zip(blocks.values(), found, strict=True)
        if not e[1] <= MOST_ERROR * e[2]
    )
    return next(far, "a loop")
