"""The noise chain in Faust, and any process of one input, compiled by g++ into a
temporary folder and called in this process.

Gaussian white noise (Box-Muller of two of its noises), the pink filter with as many
sections, 129 taps; the settings that were the fastest of all that were tried.  Sections
of second order take twice as long as those of first order here.
"""

from __future__ import annotations

import ctypes
import platform
import shutil
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from noise_chain import FS, design
from scipy import signal

FAUST = "faust -double -lang cpp -vec -vs 1024 -lv 0 -mcd 256".split()
GCC = "g++ -O3 -march=native -ffast-math -shared -fPIC".split()
STRICT = "g++ -O3 -march=native -shared -fPIC".split()
SETTINGS = {
    "Faust": "faust -double -lang cpp".split(),
    "Faust -vec": "faust -double -lang cpp -vec -lv 0 -vs 32".split(),
    "Faust -vec -vs 1024": FAUST,
}
X86 = platform.machine() in ("x86_64", "AMD64")
WIDTHS = (
    {f"vectors of {bits} bits": [f"-mprefer-vector-width={bits}"] for bits in (256, 512)}
    if X86
    else {"": []}
)
BLOCK = 1024
PROGRAM = """
import("stdfaust.lib");
u = no.multinoise(2) : _,! : +(1.0000000001) : *(0.5);
white = sqrt(-2*log(u))*cos(ma.PI*(no.multinoise(2) : !,_));
process = white : {sections} : fi.fir(({taps}));
"""
AROUND = r"""
#include <algorithm>
#include <cmath>
#include <cstring>
#define FAUSTFLOAT double
struct Meta { void declare(const char*, const char*) {} };
struct UI { void openVerticalBox(const char*) {} void closeBox() {} };
struct dsp { virtual ~dsp() {} };
<<includeIntrinsic>>
<<includeclass>>
extern "C" {
void* make(int fs) {
    auto* d = new mydsp();
    d->classInit(fs);
    d->instanceConstants(fs);
    d->instanceClear();
    return d;
}
void run(void* p, long n, double* in, double* out, int block) {
    for (long i = 0; i < n; i += block) {
        double *x[1] = {in + i}, *y[1] = {out + i};
        ((mydsp*)p)->compute((int)std::min<long>(block, n - i), x, y);
    }
}
}
"""


def missing() -> str:
    """What of faust and g++ is not installed."""
    return " and ".join(tool for tool in ("faust", "g++") if not shutil.which(tool))


def jobs(folder: Path, samples: int) -> dict[str, Callable[[], np.ndarray]]:
    """The chain for vectors of each width as a job of so many samples, which gives
    them.
    """
    sos, taps = design()
    zeros, poles, gain = signal.sos2zpk(sos)
    sections = [
        f"fi.tf1(1,{-z.real:.17g},{-p.real:.17g})" for z, p in zip(zeros, poles, strict=True)
    ]
    program = PROGRAM.format(
        sections=" : ".join([f"*({gain:.17g})", *sections]),
        taps=",".join(f"{t:.17g}" for t in taps),
    )
    _translated(folder, "chain", program, FAUST)
    made = {}
    for k, (width, option) in enumerate(WIDTHS.items()):
        library = folder / f"chain{k}.so"
        _run([*GCC, *option, "chain.cpp", "-o", library.name], folder)
        made[f"Faust C++, Gaussian noise, {width}"] = _job(library, samples)
    return made


def filters(folder: Path, process: str, x: np.ndarray, fs: float) -> dict[str, Callable]:
    """A process of one input as jobs over x, in Faust's scalar and vector code."""
    made = {}
    for how, words in SETTINGS.items():
        name = how.replace(" ", "_")
        program = f'import("stdfaust.lib");\nprocess = {process};\n'
        _translated(folder, name, program, words)
        library = folder / f"{name}.so"
        _run([*STRICT, f"{name}.cpp", "-o", library.name], folder)
        made[how] = _job(library, x.size, x, fs)
    return made


def _translated(folder: Path, name: str, program: str, words: list[str]) -> None:
    (folder / "around.cpp").write_text(AROUND)
    (folder / f"{name}.dsp").write_text(program)
    _run([*words, "-a", "around.cpp", f"{name}.dsp", "-o", f"{name}.cpp"], folder)


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stderr[-500:]}"


def _job(
    library: Path, samples: int, x: np.ndarray | None = None, fs: float = FS
) -> Callable[[], np.ndarray]:
    code = ctypes.CDLL(str(library))
    code.make.restype = ctypes.c_void_p
    dsp, out = ctypes.c_void_p(code.make(int(fs))), np.empty(samples)
    given = ctypes.c_void_p(None if x is None else x.ctypes.data)
    rows = given, ctypes.c_void_p(out.ctypes.data)
    call = partial(code.run, dsp, ctypes.c_long(samples), *rows, BLOCK)

    def job() -> np.ndarray:
        call()
        return out

    return job
