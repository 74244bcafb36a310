"""Exported C beside the processor, and the sizes of its state and code.

python benchmarks/export.py             print
python benchmarks/export.py --record    and keep the figures in results/export.csv
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from bench import Row, compared, main, row, under

import stimlib
from stimlib.export import export_c
from stimlib.motion.source import positions
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED

SCENES = "squeeze", "bumps", "viscoelastic", "click", "texture"
COMPILERS = {
    "gcc -O3 native": "gcc -std=c99 -O3 -march=native",
    "gcc -O2 with fma": "gcc -std=c99 -O2 -mfma",
    "clang -O3 native": "clang -std=c99 -O3 -march=native -w",
}
FS, SAMPLES = 8000.0, 1 << 14
Array = ctypes.POINTER(ctypes.c_double)


def pointers(rows: np.ndarray) -> ctypes.Array:
    """The rows of an array, as C takes them."""
    return (Array * max(1, len(rows)))(*(r.ctypes.data_as(Array) for r in rows))


def job(
    folder: Path, name: str, compiler: str, size: int, x: np.ndarray, y: np.ndarray
) -> Callable:
    """A call of the exported scene for all samples."""
    library = folder / f"{compiler.partition(' ')[0]}{len(compiler)}.so"
    words = [*compiler.split(), "-shared", "-fPIC", f"{name}.c", "-o", library, "-lm"]
    subprocess.run(words, cwd=folder, check=True)
    loaded, state = ctypes.CDLL(str(library)), ctypes.create_string_buffer(2 * size + 4096)
    getattr(loaded, f"{name}_init")(state)
    process, given, out = getattr(loaded, f"{name}_process"), pointers(x), pointers(y)
    return lambda kept=(loaded, x, y): process(state, given, out, SAMPLES)


def measure() -> list[Row]:
    """All rows."""
    rows = []
    there = {n: c for n, c in COMPILERS.items() if shutil.which(c.partition(" ")[0])}
    rows += [row(f"{name} is not installed") for name in COMPILERS.keys() - there.keys()]
    for name in SCENES:
        scene = SHIPPED[name]()
        motion = {n: parse_motion(m) for n, m in ROWS[name].drive.items()}
        proc = stimlib.compile(scene, FS)
        x = positions({n: motion[n] for n in proc.inputs}, 0, SAMPLES, FS)
        y = np.empty((len(proc.outputs), SAMPLES))
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            size = export_c(scene, FS, folder, motion, name, 0.01).state_bytes
            jobs = {"processor": lambda p=proc, x=x, y=y: p.process(x, y)}
            jobs |= {c: job(folder, name, words, size, x, y) for c, words in there.items()}
            rows += under(name, compared(jobs, SAMPLES, "processor"))
            rows.append(row(f"{name}: state", size, "bytes"))
            if shutil.which("arm-none-eabi-gcc"):
                rows.append(
                    row(f"{name}: code and tables, Cortex-M7 -Os", code(folder, name), "bytes")
                )
    return rows


def code(folder: Path, name: str) -> int:
    """Bytes of flash on a Cortex-M7: code and constants."""
    words = (
        "arm-none-eabi-gcc -mcpu=cortex-m7 -mthumb -mfloat-abi=hard -mfpu=fpv5-d16 -Os -std=c99 -c"
    )
    subprocess.run([*words.split(), f"{name}.c", "-o", "m7.o"], cwd=folder, check=True)
    said = subprocess.run(
        ["arm-none-eabi-size", "m7.o"], cwd=folder, capture_output=True, text=True
    )
    text, data = said.stdout.splitlines()[1].split()[:2]
    return int(text) + int(data)


if __name__ == "__main__":
    main("export", __doc__, measure)
