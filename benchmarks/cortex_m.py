"""Exported C on Cortex-M in QEMU: instructions a sample, and sizes in bytes.

python benchmarks/cortex_m.py             print
python benchmarks/cortex_m.py --record    and keep the figures in results/cortex_m.csv

QEMU counts instructions (-icount), not cycles: one takes 64 ns of its time, which the
SysTick timer of the board counts at 25 MHz. A loop of known length checks the count.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from bench import Row, main, row

from stimlib.export import export_c
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED

SCENES = "squeeze", "click", "texture", "bumps"
HERE = Path(__file__).parents[1] / "tests" / "stress" / "export"
PARTS = {  # precision, processor and machine
    "M7 float64": ("float64", "-mcpu=cortex-m7 -mfpu=fpv5-d16", "mps2-an500"),
    "M7 float32": ("float32", "-mcpu=cortex-m7 -mfpu=fpv5-d16", "mps2-an500"),
    "M4F float32": ("float32", "-mcpu=cortex-m4 -mfpu=fpv4-sp-d16", "mps2-an386"),
}
FS, BLOCK, BLOCKS = 8000.0, 64, 16
COUNT = """\
#include "{name}.h"
#include <stdio.h>
#define REAL {real}
static {name}_state m;
static volatile uint32_t *const systick = (uint32_t *)0xE000E010;
static REAL x[{ins}][{block}], y[{outs}][{block}];

static uint32_t now(void) {{ return 0xFFFFFF - systick[2]; }}

int main(void)
{{
    const REAL *in[{ins}];
    REAL *out[{outs}];
    uint32_t from, to, most = 0, sum = 0;
    int i, k;
    for (k = 0; k < {ins}; k++) in[k] = x[k];
    for (k = 0; k < {outs}; k++) out[k] = y[k];
    systick[1] = 0xFFFFFF;
    systick[2] = 0;
    systick[0] = 5;
    from = now();
    __asm volatile("mov r0, #4000\\n1: subs r0, #1\\nbne 1b" ::: "r0", "cc");
    to = now();
    printf("%lu ", (unsigned long)((to - from) & 0xFFFFFF));
    {name}_init(&m);
    for (i = 0; i < {blocks}; i++) {{
        int j;
        for (k = 0; k < {ins}; k++)
            for (j = 0; j < {block}; j++) x[k][j] = (REAL)(1e-5 * ({block} * i + j));
        from = now();
        {name}_process(&m, in, out, {block});
        to = (now() - from) & 0xFFFFFF;
        sum += to;
        if (to > most) most = to;
    }}
    printf("%lu %lu\\n", (unsigned long)sum, (unsigned long)most);
    return 0;
}}
"""
TICK = 64 * 25e6 / 1e9  # of an instruction


def measured(folder: Path, name: str, precision: str, part: str, machine: str) -> list[float]:
    """Instructions a sample, on average and at most; bytes of flash and state."""
    scene = SHIPPED[name]()
    motion = {n: parse_motion(m) for n, m in ROWS[name].drive.items()}
    export_c(scene, FS, folder, motion, name, 0.01, precision=precision)
    facts = {"name": name, "block": BLOCK, "blocks": BLOCKS, "outs": len(scene.outputs)}
    facts |= {
        "ins": max(1, len(scene.inputs)),
        "real": {"float64": "double"}.get(precision, "float"),
    }
    (folder / "count.c").write_text(COUNT.format(**facts))
    words = f"arm-none-eabi-gcc -mthumb -mfloat-abi=hard {part} -std=gnu99 -O2".split()
    start = f"--specs=rdimon.specs -nostartfiles -T {HERE}/cortex_m.ld {HERE}/cortex_m.c".split()
    sources = f"{name}.c count.c -o count.elf -lm".split()
    subprocess.run([*words, *start, *sources], cwd=folder, check=True)
    run = f"qemu-system-arm -M {machine} -icount shift=6 -semihosting-config enable=on -nographic"
    said = subprocess.run(
        [*run.split(), "-kernel", "count.elf"], cwd=folder, capture_output=True, text=True
    ).stdout
    loop, total, most = (int(v) / TICK for v in said.split())
    assert abs(loop - 8000) < 40, f"the loop of 8000 instructions took {loop}"
    subprocess.run([*words, "-Os", "-c", f"{name}.c"], cwd=folder, check=True)
    sizes = subprocess.run(
        ["arm-none-eabi-size", f"{name}.o"], cwd=folder, capture_output=True, text=True
    )
    code = sum(map(int, sizes.stdout.splitlines()[1].split()[:2]))
    (folder / "state.c").write_text(f'#include "{name}.h"\n{name}_state m;\n')
    subprocess.run([*words, "-c", "state.c"], cwd=folder, check=True)
    sizes = subprocess.run(
        ["arm-none-eabi-size", "state.o"], cwd=folder, capture_output=True, text=True
    )
    state = int(sizes.stdout.splitlines()[1].split()[2])
    return [total / BLOCK / BLOCKS, most / BLOCK, code, state]


def measure() -> list[Row]:
    """All rows."""
    for program in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if not shutil.which(program):
            return [row(f"{program} is not installed")]
    rows = []
    for name in SCENES:
        for label, how in PARTS.items():
            with tempfile.TemporaryDirectory() as place:
                mean, most, code, state = measured(Path(place), name, *how)
            rows += [
                row(f"{name}, {label}: instructions a sample", mean, ""),
                row(f"{name}, {label}: instructions a sample, slowest call of 64", most, ""),
                row(f"{name}, {label}: code and tables", code, "bytes"),
                row(f"{name}, {label}: state", state, "bytes"),
            ]
    return rows


if __name__ == "__main__":
    main("cortex_m", __doc__, measure)
