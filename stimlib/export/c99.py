"""Export of a scene as plain C99, whose samples have the same bits."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.program import number, rate
from ..core.scene import Scene
from ..errors import BadValue, SinkError, public
from ..motion.source import positions, sources_of
from ..run.driver import samples
from ..run.processor import Change, compile
from ..run.safety import GAIN, Safety, protect
from ..system.limits import limits
from ..system.safe_files import make_folder, publish
from .program import Writer

NAME = re.compile(r"[a-z][a-z0-9_]{0,40}")
RAMP = 0.01  # seconds, of the parameters in the self test

TAKEN = frozenset(
    "st stimlib math string stdint stdio test all help clean install package con aux nul"
    " prn".split()
)
"""Names of files that are included, of targets of CMake and of devices of Windows."""
MACROS = ("export", "fs", "inputs", "outputs", "tile")  # of the header, beside those of parameters
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

`{name}_test.c` compares {samples} samples with those of stimlib, bit by bit. Build and run it once
with the compiler and the options of your program:

    cc -std=c99 -O2 {name}.c {name}_test.c -o {name}_test -lm && ./{name}_test

It must print "0 of {samples} samples differ". Options that let a compiler change results, such as
-ffast-math and -ffp-contract=fast, break this; -ffast-math is refused.
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
    """

    files: tuple[Path, ...]
    state_bytes: int
    samples: int


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
        Length of the self test. After a third of it every parameter is moved by 10 %,
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

    Returns
    -------
    Exported

    Raises
    ------
    BadValue
        A name that C does not take, or parameters whose macros would be the same; fs,
        seconds, tile or a parameter out of range; a motion that is missing or short.
    SceneError
        A block with a part that has no form in C; the message names file and line.
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
        raise BadValue(f"export_c: name = {name!r} is taken in C, CMake or Windows; give another")
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
    n = max(3, round(number(seconds, "seconds") * fs))
    for one, source in motion.items():
        if not callable(source) and len(source) < n:
            raise BadValue(
                f"export_c: motion of {one} has {len(source)} samples and the self test {n}; give"
                f" more, or seconds={len(source) / fs:g}"
            )
    limits.check("render_bytes", 8 * n * len(proc.outputs), "export_c: bytes of the self test")
    x = positions(sources_of(motion, proc.inputs, n), 0, n, fs)
    writer, cut, first = Writer(proc, name, tile), n // 3, proc.state
    changes = [
        Change(cut, p, v * (1.1 if abs(v) < 1e308 else 0.9), RAMP) for p, v in proc.params.items()
    ]
    if safety:
        fade = Change(0, GAIN, 1.0, safety.samples(fs) / fs)
        changes = [fade, *(c for c in changes if c.name != GAIN)]
    y = samples(proc, x, n, changes)
    proc.state = first
    made = writer.files(x, y, changes)
    from ..version import __version__

    facts = {"name": name, "fs": fs, "size": writer.size, "samples": y.size, "version": __version__}
    texts = {
        f"{name}.h": made.header,
        f"{name}.c": made.source,
        f"{name}_test.c": made.test,
        "CMakeLists.txt": CMAKE.format(**facts),
        "README.md": README.format(**facts),
    }
    into = make_folder(folder)
    for path in (into / file for file in texts):
        if path.is_file() and MARK not in path.read_bytes()[:1000]:
            raise SinkError(f"{path} is there already, from elsewhere; give another folder or name")
    for file, text in texts.items():
        publish(into / file, text)
    return Exported(tuple(into / file for file in texts), writer.size, y.size)
