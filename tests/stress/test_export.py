"""Exported C on the compilers and machines that are installed: every block of the
table, and every shipped scene.

STIMLIB_STRESS=1 pytest -m stress tests/stress/test_export.py. Zig (the package
ziglang) compiles for other machines; ZIG names its program.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from exported import compared, exported, groups

from stimlib.export import export_c
from stimlib.motion.text import parse_motion
from stimlib.scenes import ROWS, SHIPPED

pytestmark = [pytest.mark.stress, pytest.mark.xdist_group("export")]
HERE = Path(__file__).parent / "export"
ZIG = os.environ.get("ZIG", shutil.which("zig") or "zig").split()
ARM = "arm-none-eabi-gcc -mthumb -mfloat-abi=hard -O2 -std=c99 --specs=rdimon.specs -nostartfiles"
ARM += f" -T {HERE / 'cortex_m.ld'} {HERE / 'cortex_m.c'}"
QEMU = "-semihosting-config enable=on -nographic -kernel"
CHAINS = {  # how to compile, how to run
    "gcc": ("gcc -std=c99 -O2".split(), []),
    "gcc native": ("gcc -std=gnu17 -O3 -march=native".split(), []),
    "g++": ("g++ -std=c++17 -O2 -x c++".split(), []),
    "clang": ("clang -std=c99 -O3 -march=native".split(), []),
    "windows": ([*ZIG, *"cc -target x86_64-windows-gnu -std=c99 -O1".split()], ["wine"]),
    "aarch64": ([*ZIG, *"cc -target aarch64-linux-musl -std=c99 -O1".split()], ["qemu-aarch64"]),
    "armv7": ([*ZIG, *"cc -target arm-linux-musleabihf -std=c99 -O1".split()], ["qemu-arm"]),
    "wasm32": (
        [*ZIG, *"cc -target wasm32-wasi -std=c99 -O1".split()],
        ["node", "--no-warnings", str(HERE / "wasi.mjs")],
    ),
    "cortex-m7": (
        f"{ARM} -mcpu=cortex-m7 -mfpu=fpv5-d16".split(),
        f"qemu-system-arm -M mps2-an500 {QEMU}".split(),
    ),
    "cortex-m4f": (  # double precision in software
        f"{ARM} -mcpu=cortex-m4 -mfpu=fpv4-sp-d16".split(),
        f"qemu-system-arm -M mps2-an386 {QEMU}".split(),
    ),
}
DOUBLE = "detents", "friction", "ultrasonic_friction", "tone", "pulse"  # refused in float32
LARGE = ("touch_screen",)  # its table of a mode shape takes 77 MB of text


@pytest.fixture(params=CHAINS)
def chain(request):
    compiler, run = CHAINS[request.param]
    for program in (compiler[0], *run[:1]):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed")
    return request.param, compiler, run


def same(folder, name, samples, chain):
    _, compiler, run = chain
    said = compared(folder, name, compiler, run, ["-w", "-lm"])
    assert said.splitlines() == [f"0 of {samples} samples differ"], said  # not 100 of 800


@pytest.mark.parametrize("name", [n for n in SHIPPED if n not in LARGE])
def test_a_scene(name, chain, tmp_path):
    if chain[0] == "cortex-m4f":
        pytest.skip("the fma of newlib, without a unit for doubles, is not fused: float32 only")
    motion = {n: parse_motion(m) for n, m in ROWS[name].drive.items()}
    made = export_c(SHIPPED[name](), 8000, tmp_path, motion, name, 0.25)
    same(tmp_path, name, made.samples, chain)


@pytest.mark.parametrize("name", [n for n in SHIPPED if n not in (*LARGE, *DOUBLE)])
def test_a_scene_in_float32(name, chain, tmp_path):
    motion = {n: parse_motion(m) for n, m in ROWS[name].drive.items()}
    made = export_c(SHIPPED[name](), 8000, tmp_path, motion, name, 0.25, precision="float32")
    same(tmp_path, name, made.samples, chain)


@pytest.mark.parametrize("k", range(len(groups())))
def test_the_table_of_blocks(k, chain, tmp_path):
    if chain[0].startswith("cortex"):
        pytest.skip("forty blocks and their samples do not fit into its 4 MB; scenes do")
    same(tmp_path, f"group{k}", exported(k, tmp_path), chain)


def test_large_tables(tmp_path):
    motion = {n: parse_motion(m) for n, m in ROWS["touch_screen"].drive.items()}
    made = export_c(SHIPPED["touch_screen"](), 8000, tmp_path, motion, "touch_screen", 0.1)
    same(tmp_path, "touch_screen", made.samples, ("", ["gcc", "-std=c99", "-O0"], []))


def test_cmake(tmp_path):
    if not shutil.which("cmake"):
        pytest.skip("cmake is not installed")
    motion = {"x": parse_motion(ROWS["wall"].drive["x"])}
    export_c(SHIPPED["wall"](), 8000, tmp_path, motion, "wall")
    for words in ("-B build", "--build build"):
        subprocess.run(["cmake", *words.split()], cwd=tmp_path, check=True, capture_output=True)
    said = subprocess.run([tmp_path / "build" / "wall_test"], capture_output=True, text=True)
    assert said.stdout.splitlines() == ["0 of 800 samples differ"], said.stdout
