"""Export to C99: the same bits as the processor, from every block of the table."""

import ctypes
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import ran
from contract import TABLE
from correct import OwnHighPass
from exported import COUNT, FAST, GCC, compared, exported, groups, same, shipped
from laws import mostly
from memory import most_memory
from refusals import largest_file, refused

import stimlib
from stimlib import BadValue, Input, Param, Scene, SinkError, UnitError, enabled
from stimlib.blocks import oscillator, pink_noise, pinking, springpot, velocity, wall, white_noise
from stimlib.export import INCLUDE, export_c
from stimlib.export.program import comment
from stimlib.run.safety import Inverse, Passivity, Safety, Watch, protect
from stimlib.scenes import ROWS, SHIPPED

pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
ROOT = Path(__file__).parents[1]
HERE = Path(__file__).parent / "stress" / "export"
ZIG = os.environ.get("ZIG", shutil.which("zig") or "zig").split()
ARM = "arm-none-eabi-gcc -mthumb -mfloat-abi=hard -O2 -std=c99 --specs=rdimon.specs -nostartfiles"
ARM += f" -T {HERE / 'cortex_m.ld'} {HERE / 'cortex_m.c'}"
QEMU = "-semihosting-config enable=on -nographic -kernel"
CHAINS = {  # how to compile, how to run; zig is the package ziglang, ZIG names its program
    "gcc quickly": (FAST, []),
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
IN_DOUBLE = "detents", "friction", "ultrasonic_friction", "tone", "pulse"  # refused in float32


def installed(chain):
    """How to compile and to run, where both programs are there."""
    compiler, run = CHAINS[chain]
    for program in (compiler[0], *run[:1]):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed")
    return compiler, run


@pytest.mark.parametrize("chain", mostly(["gcc quickly"], CHAINS))
@pytest.mark.parametrize("k", mostly(range(COUNT - 1), range(COUNT)))
def test_every_block_of_the_table_has_the_same_bits(k, chain, tmp_path):
    there = sorted(n for _, scene, _ in groups() for n in scene.outputs)
    assert there == sorted(e.name for e in TABLE) and len(groups()) == COUNT
    if chain.startswith("cortex"):
        pytest.skip("forty blocks and their samples do not fit into its 4 MB; scenes do")
    programs = installed(chain)
    assert same(tmp_path, f"group{k}", exported(k, tmp_path), *programs)


@pytest.mark.stress
@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", SHIPPED)
def test_every_scene_has_the_same_bits(name, precision, chain, tmp_path):
    if name == "touch_screen" and (chain, precision) != ("gcc quickly", "float64"):
        pytest.skip("its table of a mode shape takes 77 MB of text: once is enough")
    if name in IN_DOUBLE and precision == "float32":
        pytest.skip("it is refused in float32")
    if chain == "cortex-m4f" and precision == "float64":
        pytest.skip("the fma of newlib, without a unit for doubles, is not fused: float32 only")
    programs = installed(chain)
    assert same(tmp_path, name, shipped(name, tmp_path, precision=precision).samples, *programs)


@pytest.mark.stress
@pytest.mark.skipif(not shutil.which("cmake"), reason="cmake is not installed")
def test_cmake_builds_an_export(tmp_path):
    shipped("wall", tmp_path, 0.1)
    for words in ("-B build", "--build build"):
        subprocess.run(["cmake", *words.split()], cwd=tmp_path, check=True, capture_output=True)
    said = subprocess.run([tmp_path / "build" / "wall_test"], capture_output=True, text=True)
    assert said.stdout.splitlines() == ["0 of 800 samples differ"], said.stdout


@pytest.mark.parametrize("name, tile", [("squeeze", 64), ("viscoelastic", 1)])
def test_a_scene_compiles_without_a_warning_and_optimised(name, tile, tmp_path):
    made = shipped(name, tmp_path, 0.2, tile=tile)
    assert same(tmp_path, name, made.samples, [*GCC, "-O3", "-march=native"])
    header = (tmp_path / f"{name}.h").read_text()
    assert f"{name.upper()}_TILE {tile} " in header
    assert all(n in header for n in SHIPPED[name]().outputs)


def test_parameters_gates_and_cuts(tmp_path):
    """A program of our own that calls as a servo loop does, one sample at a time; what
    is not finite is not taken.
    """
    x, k = Input("x", "m"), Param("k", 100.0, "N/m")
    noise = enabled(pink_noise(1.0, 3), velocity(x) > stimlib.constant(0.0, "m/s"))
    scene = Scene({"f": k * x + stimlib.constant(1.0, "N") * noise})
    way = 0.01 * np.sin(np.arange(300) / 20)
    export_c(Scene({"y": oscillator(Param("f", 480.0, "Hz"))}), 1000, tmp_path / "near half fs")
    made = export_c(scene, 1000, tmp_path, {"x": way}, params={"k": 250.0})
    proc = stimlib.compile(scene, 1000)
    proc.set("k", 250.0, ramp=0.0)
    first = proc.process(way[None, :100].copy())
    proc.set("k", 450.0, ramp=0.0)
    proc.set("k", 50.0, ramp=0.02)
    want = np.r_[first[0], proc.process(way[None, 100:200].copy())[0]]
    proc.set("k", 80.0, ramp=0.0)
    want = np.r_[want, proc.process(way[None, 200:].copy())[0]]
    rows = ", ".join(map(float.hex, way))
    (tmp_path / "servo.c").write_text(f"""
#include "stimulus.h"
#include <math.h>
#include <stdio.h>
static const double way[] = {{ {rows} }};
int main(void)
{{
    stimulus_state m;
    int i;
    stimulus_init(&m);
    for (i = 0; i < 300; i++) {{
        const double *in[1] = {{ way + i }};
        double y, *out[1] = {{ &y }};
        if (i == 100) stimulus_set(&m, STIMULUS_K, 450.0, 0.0);
        if (i == 100) stimulus_set(&m, STIMULUS_K, 50.0, 20.0);
        if (i == 150) stimulus_set(&m, STIMULUS_K, NAN, 0.0);
        if (i == 151) stimulus_set(&m, STIMULUS_K, INFINITY, 0.0);
        if (i == 200) stimulus_set(&m, STIMULUS_K, 80.0, NAN);
        stimulus_process(&m, in, out, 1);
        printf("%a\\n", y);
    }}
    printf("%a\\n", (double)sizeof m);
    return 0;
}}
""")
    subprocess.run([*GCC, "servo.c", "stimulus.c", "-o", "servo", "-lm"], cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "servo"], capture_output=True, text=True).stdout
    *got, size = (float.fromhex(v) for v in said.split())
    np.testing.assert_array_equal(got, want)
    assert made.state_bytes == pytest.approx(size, rel=0.02)
    assert np.ptp(want) > 1


def test_the_passivity_controller_is_exported(tmp_path):
    scene = Scene({"force": wall(Input("x", "m"), 1000.0)})
    passive = Passivity(1e-3, 2.0, delay=0.0025, encoder=1e-6, still=0.05)
    way = {"x": 0.01 * np.sin(np.arange(600) / 20)}
    made = export_c(scene, 1000, tmp_path, way, seconds=0.6, safety=Safety(6.0, passivity=passive))
    assert same(tmp_path, "stimulus", made.samples, GCC)
    assert "of force" in re.findall(
        r"b\d+_n passivity (of \w+)", (tmp_path / "stimulus.h").read_text()
    )


STAGES = {"peak", "clip", "static", "slew", "drive", "skin", "outside"}
INVERSE = Inverse((0.2, 0.9, 0.2), (1.2, 0.9, 0.3), 2)


def test_the_safety_stage_is_exported_with_its_counts(tmp_path):
    """Each stage limits samples, and one output fails, as in a processor."""
    x, k = Input("x", "m"), Param("k", 1000.0, "N/m")
    scene = Scene({"force": k * x, "wave": 5.0 * x / x})
    safety = Safety({"force": 6.0, "wave": 4.0}, {"force": 900.0}, 8.0, 0.2, 0.05, INVERSE)
    way = 0.0101 * np.sin(np.arange(600) ** 1.5 / 300) + 0.01
    way[500:] = 0.0  # 0/0 there
    made = export_c(scene, 1000, tmp_path, {"x": way}, seconds=0.6, safety=safety)
    assert same(tmp_path, "stimulus", made.samples, GCC)
    proc = stimlib.compile(protect(scene, safety), 1000)
    proc.set("sink_gain", 1.0, ramp=safety.samples(1000) / 1000)
    want = [proc.process(way[None, :200].copy())]
    proc.set("k", 900.0, ramp=0.01)
    want.append(proc.process(way[None, 200:].copy()))
    counts = {stage: sum(of.values()) for stage, of in Watch(proc).counts().items()}
    counts["outside"] = Watch(proc).outside()["force"]["samples"]
    assert counts.keys() == STAGES and abs(want[1][1, 298]) > 1.0 and want[1][1, -1] < 1.0
    fields = re.findall(r"(b\d+_n) (\w+) of", (tmp_path / "stimulus.h").read_text())
    prints = "".join(f'printf("{stage} %d\\n", (int)m.{f});' for f, stage in fields)
    prints += 'for (k = 0; k < 1200; k++) printf("%a\\n", y[k / 600][k % 600]);'
    test = tmp_path / "stimulus_test.c"
    test.write_text(test.read_text().replace("    return differ", f"{prints} return differ"))
    _, *lines = compared(tmp_path, "stimulus", GCC).splitlines()
    found = [line.split() for line in lines[: len(fields)]]
    assert {s: sum(int(n) for t, n in found if t == s) for s in STAGES} == counts
    got = [float.fromhex(v) for v in lines[len(fields) :]]
    np.testing.assert_array_equal(got, np.concatenate(want, axis=1).ravel())
    refused(UnitError, "different units", export_c, scene, 1000, tmp_path, safety=Safety(4.0))


X = Input("x")
OPEN = X > stimlib.constant(0.0)
INNER = enabled(white_noise(3) * Param("g", 2.0), pink_noise(1.0, 5) > stimlib.constant(0.0))
RAMP = np.concatenate([np.linspace(0, 1, 70), np.full(50, 1.0), np.linspace(1, 0.3, 80)])
SMALL = np.zeros(300)
SMALL[:100], SMALL[100:150] = 1e-188 * np.sin(np.arange(100) ** 2), 3e-191 * np.cos(np.arange(50))


@pytest.mark.parametrize(
    ("outputs", "motion", "more"),
    [
        # a parameter that ramps is gathered there from the whole scene's samples
        (
            {"y": enabled(pink_noise(1.0, 4) + INNER, OPEN)},
            {"x": np.sin((np.arange(300) - 103.5) / 5)},
            {},
        ),
        # what keeps recursions off the denormals is seen in signals of 1e-188
        ({"modes": pinking(X, 20.0), "memory": springpot(X, 1.0, 0.5)}, {"x": SMALL}, {}),
        # rows of weights, pieces of a tile that stay and that move, and both ends
        (
            {"f": springpot(X, 1.0, Input("a"))},
            {"x": 1e-3 * np.sin(np.arange(200) ** 2), "a": RAMP},
            {},
        ),
        ({"w": white_noise(3), "p": pink_noise(1.0, 4)}, {}, {"seed": 5}),
        # and an output of its input's name
        (
            {"own": OwnHighPass(X, 0.01), "x": stimlib.constant(2.0, "N") * X},
            {"x": np.linspace(-1, 1, 100)},
            {},
        ),
    ],
    ids=["gate in a gate", "smallest", "moving order", "seed", "a user's block"],
)
def test_a_scene_has_the_same_bits(outputs, motion, more, tmp_path):
    n, scene = max(map(len, motion.values()), default=100), Scene(outputs)
    made = export_c(scene, 1000, tmp_path, motion, seconds=n / 1000, **more)
    assert same(tmp_path, "stimulus", made.samples)
    y = stimlib.render(scene, motion, 1000, n / 1000, **more).y
    assert (np.count_nonzero(y[:, :90], axis=1) > 25).all() and np.abs(y).max() < 100
    if "own" in outputs:  # its step is quoted
        text = (tmp_path / "stimulus.c").read_text()
        assert "def step(p, s, x):" in text and "y = p.p * (s.y + x - s.x)" in text
        said = "inputs: 0 x [1]\n   outputs: 0 own [1], 1 x [N]\n"
        assert said in (tmp_path / "stimulus.h").read_text()


DOUBLED, ONES = Scene({"y": X * 2.0}), {"x": np.ones(100)}


def test_a_self_test_that_differs_says_so(tmp_path):
    export_c(Scene({"y": 2 * Input("x")}), 1000, tmp_path, ONES)
    path = tmp_path / "stimulus.c"
    source = path.read_text()
    assert source.count("(a * b)") == 1
    path.write_text(source.replace("(a * b)", "(a * b + 1e-300)"))
    assert same(tmp_path, "stimulus", 100)  # lost in rounding
    path.write_text(source.replace("(a * b)", "(a * b + 1e-15)"))
    said = compared(tmp_path, "stimulus", FAST)
    assert said.endswith("100 of 100 samples differ\n") and "output 0, sample 0: 2" in said
    assert subprocess.run([tmp_path / "stimulus.exe"], capture_output=True).returncode == 1


def test_a_compiler_that_would_change_samples_is_refused_and_files_of_two_exports(tmp_path):
    """Such as after an export that was killed between two files."""

    def fails(says, *options):
        words = [*FAST, *options, "-c", "stimulus.c"]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode and says in done.stderr, done.stderr

    export_c(DOUBLED, 1000, tmp_path, ONES, seconds=0.05)
    fails("without -ffast-math", "-ffast-math")
    probe = ["gcc", "-mfpmath=387", "-x", "c", "-dM", "-E", "/dev/null"]
    if b"FLT_EVAL_METHOD__ 2" in subprocess.run(probe, capture_output=True).stdout:
        fails("without excess precision", "-mfpmath=387")
    old = (tmp_path / "stimulus.c").read_text()
    export_c(DOUBLED, 2000, tmp_path, ONES, seconds=0.05)
    (tmp_path / "stimulus.c").write_text(old)
    fails("stimulus.h is of another export")


@pytest.mark.parametrize(
    ("told", "error", "says"),
    [
        ({"motion": {}}, BadValue, "no motion for x"),
        ({"name": "My sound"}, BadValue, "name = 'My sound'"),
        ({"tile": 0}, BadValue, "tile = 0"),
        ({"tile": 65}, BadValue, "tile = 65"),
        ({"fs": 0}, BadValue, "fs = 0"),
        ({"motion": {"x": np.ones(99)}}, BadValue, "x has 99 samples and the self test 100"),
        ({"motion": {"x": 0.01}}, BadValue, "motion of x: need one dimension"),
        ({"seconds": -1.0}, BadValue, "at least one sample"),
        ({"params": {"level": 1.0}}, stimlib.UnknownName, "level"),
        *(
            ({"scene": Scene({f"y{n}": X * Param(n, 1.0) for n in names})}, BadValue, "rename")
            for names in (["k", "K"], ["fs"], ["tile"], ["fault"])
        ),
        *(
            ({"name": name}, BadValue, f"'{name}' is taken.*'{name}_stimulus'")
            for name in ("math", "test", "stimlib", "double", "limits", "errno", "com1", "lpt9")
        ),
    ],
)
def test_what_is_refused_writes_nothing(told, error, says, tmp_path):
    words = {"scene": DOUBLED, "fs": 1000, "folder": tmp_path, "motion": ONES} | told
    refused(error, says, export_c, **words)
    assert not list(tmp_path.iterdir())


def test_files_from_elsewhere_are_kept_and_those_of_an_export_replaced(tmp_path):
    told = (DOUBLED, 1000, tmp_path, ONES)
    (tmp_path / "README.md").write_text("My project")
    refused(SinkError, "from elsewhere", export_c, *told)
    assert [p.name for p in tmp_path.iterdir()] == ["README.md"]
    (tmp_path / "README.md").unlink()
    os.truncate(os.open(tmp_path / "stimulus.c", os.O_CREAT | os.O_WRONLY), 2**28)
    _, most = most_memory(refused, SinkError, "from elsewhere", export_c, *told)
    assert most < 2**27, "a file is read to its thousandth byte"
    (tmp_path / "stimulus.c").unlink()
    for fs in (1000, 2000):
        export_c(DOUBLED, fs, tmp_path, ONES, seconds=0.05)
    assert "2000 Hz" in (tmp_path / "README.md").read_text()


def test_an_export_is_whole_or_absent(tmp_path):
    """A disk that is full before the last file, or a name that is a folder."""
    sizes = sorted(len(p.read_bytes()) for p in export_c(DOUBLED, 1000, tmp_path / "a", ONES).files)
    told = (DOUBLED, 1000, tmp_path / "b", ONES)
    for most in (sizes[0] - 1, sizes[-1] - 1, sizes[-2] - 1):
        with largest_file(most):
            refused(SinkError, "cannot write", export_c, *told)
        assert not list((tmp_path / "b").iterdir())
    (tmp_path / "b/README.md").mkdir()
    refused(SinkError, "is a folder", export_c, *told)
    assert [p.name for p in (tmp_path / "b").iterdir()] == ["README.md"]


ALONE = '#include "b.h"\nunsigned long alone = sizeof(b_state);\n'
BOTH = """
#include "a.h"
#include "b.h"
extern unsigned long alone;
int main(void) { return alone != sizeof(b_state); }
"""


def test_two_stimuli_of_different_tiles_in_one_program(tmp_path):
    """The header of one must not change the state of the other."""
    for name, tile in (("a", 8), ("b", 64)):
        export_c(DOUBLED, 1000, tmp_path, ONES, name, tile=tile)
    (tmp_path / "alone.c").write_text(ALONE)
    (tmp_path / "both.c").write_text(BOTH)
    subprocess.run([*GCC, "alone.c", "both.c", "-o", "both"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "both"]).returncode == 0


def test_no_text_ends_a_comment():
    assert comment("a */ b /* c ??/\n/ d *\\\n/ e") == "a * / b / * c ? ? /\n * / d *\n * / e"


def test_the_command_exports_and_says_how_to_compile(tmp_path):
    words = ["export", "wall", "--motion", ROWS["wall"].drive["x"], "--name", "wall"]
    said = ran([*words, "--out", tmp_path]).stdout
    assert "cc -std=c99 -O2 wall.c wall_test.c" in said and "self test: 800 samples" in said
    limits = ["--full-scale", "5", "--slew", "100", "--json"]
    assert json.loads(ran([*words, "--out", tmp_path, *limits]).stdout)["samples"] == 800
    assert same(tmp_path, "wall", 800)
    assert "_n slew of force" in (tmp_path / "wall.h").read_text()
    ran([*words, "--out", tmp_path, "--peak", "5"], 2, "--full-scale is missing")
    said = ran([*words, "--out", tmp_path, "--float32"]).stdout
    assert "error of float32 in force: rms" in said and same(tmp_path, "wall", 800)


@pytest.mark.parametrize("name", "abc")
def test_parameters_of_a_processor_are_set_in_c_as_in_python(name, tmp_path):
    """Any of them; at once, along a ramp, and along a ramp from where a jump ends."""
    way = "void put(void *r, int k, double v, double n) { stimlib_set_processor(r, k, v, n); }"
    (tmp_path / "put.c").write_text(f'#include "stimlib.h"\n{way}\n')
    words = [*GCC, "-shared", "-fPIC", "-I", INCLUDE, "put.c", "-o", "put.so"]
    subprocess.run(words, cwd=tmp_path, check=True)
    put = ctypes.CDLL(str(tmp_path / "put.so")).put
    put.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_double, ctypes.c_double]
    scene = Scene({"y": Param("a", 1.0) + 10.0 * Param("b", 1.0) + 100.0 * Param("c", 1.0)})
    c, python = stimlib.compile(scene, 1000), stimlib.compile(scene, 1000)
    for settings in ([(7.0, 0)], [(3.0, 4)], [(5.0, 0), (9.0, 3)], [(9.0, 3), (5.0, 0)]):
        for value, samples in settings:
            put(c.address[1], list(c.params).index(name), value, samples)
            python.set(name, value, samples / 1000)
        np.testing.assert_array_equal(c.process(5), python.process(5))


STANDALONE = """
#include "stimlib.h"
#include "wall.h"
#include <chrono>
#include <cstdio>
#include <thread>
#include <vector>
extern "C" {
void *servo_start(stimlib_process, stimlib_set, void *, double, long);
void servo_want(void *, double);
long servo_stop(void *);
long servo_take(void *, double *, double *, long *);
}
int main()
{
    static wall_state state;
    wall_init(&state);
    void *servo = servo_start(wall_run, wall_run_set, &state, 4000.0, 4000);
    for (int k = 0; k < 20; k++) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        servo_want(servo, 1000.0 + k);
    }
    const long n = servo_stop(servo);
    std::vector<double> x(n), y(n);
    long changed;
    servo_take(servo, x.data(), y.data(), &changed);
    std::printf("%s\\n", n > 10 && changed > 0 ? "ran" : "stood still");
}
"""
SERVO = ROOT / "examples" / "servo_loop"


@pytest.mark.skipif(not shutil.which("g++"), reason="g++ is not installed")
def test_a_servo_loop_runs_both_and_gets_the_same_bits():
    """A thread of C++ calls the compiled processor, then exported C, at 4 kHz."""
    said = subprocess.run([sys.executable, SERVO / "servo.py"], capture_output=True, text=True)
    assert said.stdout == (
        "compiled processor: equal, bit for bit\nexported C: equal, bit for bit\n"
    ), said.stderr


@pytest.mark.skipif(not shutil.which("g++"), reason="g++ is not installed")
def test_a_servo_loop_has_no_data_race(tmp_path):
    """By ThreadSanitizer, with the parameter set from another thread."""
    export_c(SHIPPED["wall"](), 4000, tmp_path, {"x": np.zeros(400)}, "wall", 0.05)
    (tmp_path / "main.cpp").write_text(STANDALONE)
    words = ["g++", "-std=c++17", "-O1", "-g", "-fsanitize=thread", "-fpermissive", "-w"]
    words += ["-I", INCLUDE, "-I.", "main.cpp", SERVO / "servo.cpp", "wall.c", "-o", "servo"]
    made = subprocess.run([*words, "-lpthread"], cwd=tmp_path, capture_output=True, text=True)
    if "cannot find" in made.stderr:
        pytest.skip("ThreadSanitizer is not installed")
    said = subprocess.run([tmp_path / "servo"], capture_output=True, text=True)
    if "unexpected memory mapping" in said.stderr:
        pytest.skip("ThreadSanitizer does not run on this kernel")
    assert said.stdout == "ran\n" and not said.stderr, said.stderr
