"""Export in float32: the error that it states, and what it refuses."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from exported import GCC, same, shipped
from refusals import refused

import stimlib
from stimlib import Block, Input, MissingPackage, Param, Scene, SceneError, SinkError
from stimlib.blocks import carrier, elapsed, friction, lowpass, pink_noise, white_noise
from stimlib.core import maths
from stimlib.export import export_c
from stimlib.export.c99 import differences
from stimlib.run import Safety, protect
from stimlib.scenes import SHIPPED

pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
NARROW = {"precision": "float32"}


class P(NamedTuple):
    a: float


@dataclass(frozen=True, eq=False)
class Waves(Block):
    x: Block

    def design(self, fs):
        return P(0.1), P(0.0)

    @staticmethod
    def step(p, s, x):
        return maths.exp(x) + maths.sin(x) * maths.tanh(x) + maths.cos(x) * p.a, s


def test_sums_and_products_are_those_of_numpy_in_float32(tmp_path):
    """Numbers and inputs are rounded once, and each operation rounds to float32."""
    x, way = Input("x", "m"), 0.03 * np.sin(np.arange(300) / 7.3)
    scene = Scene({"force": Param("k", 123.4, "N/m") * x - stimlib.constant(0.1, "N")})
    made = export_c(scene, 1000, tmp_path, {"x": way}, seconds=0.3, **NARROW)
    assert same(tmp_path, "stimulus", 300, [*GCC, "-O3"])
    text = (tmp_path / "stimulus_test.c").read_text().partition("wanted[]")[2]
    words = re.findall("UINT32_C\\((0x[0-9a-f]{8})\\)", text)
    got, f = np.array([int(w, 16) for w in words], np.uint32).view(np.float32), np.float32
    want = f(123.4) * way[:100].astype(f) - f(0.1)
    assert got[:100].tobytes() == want.tobytes()
    y = 123.4 * way[:100] - 0.1
    rms, most, peak = made.errors["force"]
    assert np.abs(want - y).max() <= most < 6e-7 and 0 < rms < most
    assert peak == pytest.approx(123.4 * 0.03 + 0.1, rel=0.01)
    header = (tmp_path / "stimulus.h").read_text()
    assert f"force: rms {rms:.2g}, at most {most:.2g} N, which is" in header
    assert "const float *const *in" in header and "double" not in header
    assert f"at most {most:.2g} N" in (tmp_path / "README.md").read_text()
    assert made.state_bytes < 0.6 * export_c(scene, 1000, tmp_path, {"x": way}).state_bytes


def test_noise_filters_and_a_safety_stage_in_float32(tmp_path):
    """Seeds and phases are whole numbers, so noise differs by rounding only."""
    x = Input("x", "m")
    noise = white_noise(3) + pink_noise(1.0, 4)
    scene = Scene({"noise": noise, "wave": carrier(93.7), "slow": lowpass(x, 0.5)})
    way = 0.03 * np.sin(np.arange(800) / 7.3)
    safety = Safety({"noise": 3.0, "wave": 1.0, "slow": 0.01}, fade=0.02)
    made = export_c(scene, 4000, tmp_path, {"x": way}, seconds=0.2, safety=safety, **NARROW)
    assert same(tmp_path, "stimulus", 2400, [*GCC, "-O2"])
    relative = {n: most / peak for n, (_, most, peak) in made.errors.items()}
    assert max(relative.values()) < 5e-6, relative


def test_mathematics_of_our_own_is_in_double_and_all_else_in_single_precision(tmp_path):
    made = export_c(
        Scene({"y": Waves(Input("x"))}), 1000, tmp_path, {"x": np.linspace(-2, 2, 100)}, **NARROW
    )
    assert same(tmp_path, "stimulus", 100, [*GCC, "-O2"])
    assert made.errors["y"][1] < 2e-7 * made.errors["y"][2]
    source = re.sub(r"/\*.*?\*/", "", (tmp_path / "stimulus.c").read_text(), flags=re.S)
    assert "double stim_exp(double x)" in source and " stim_Waves_step(" in source
    assert not re.search(r"\bdouble\b", source.partition("stim_Waves_step")[2])
    assert not re.search(r"\b(double|fma|fabs|sqrt)\b", source.partition("uint64_t st_bits")[0])


def test_a_scene_in_float32(tmp_path):
    made = shipped("bumps", tmp_path, 0.1, **NARROW)
    assert same(tmp_path, "bumps", made.samples, [*GCC, "-O3", "-march=native"])
    assert all(most < 1e-4 * peak for _, most, peak in made.errors.values())


@dataclass(frozen=True, eq=False)
class Words(Block):
    x: Block

    def design(self, fs):
        return (), P(0.0)

    @staticmethod
    def work(p):
        return 64

    @staticmethod
    def tile(p, s, x, y, w):
        u = maths.words(w)
        for i in range(y.size):
            u[i] = maths.bits(x[i])
            y[i] = maths.unbits(u[i])
        return s


@dataclass(frozen=True, eq=False)
class Own(Block, abstract=True):
    x: Block

    def design(self, fs):
        return (), P(0.0)


@dataclass(frozen=True, eq=False)
class Turns(Own):
    @staticmethod
    def step(p, s, x):
        n = 1.0 + s.a
        return x * n, P(a=n)


@dataclass(frozen=True, eq=False)
class Pairs(Own):
    @staticmethod
    def step(p, s, x):
        one, two = 2.0 * x, 3.0 * x
        return one * s.a + two, P(s.a + 1.0)


@dataclass(frozen=True, eq=False)
class Adds(Own):
    @staticmethod
    def step(p, s, x):
        n = s.a
        n += 1.0
        return x * n, P(n)


@dataclass(frozen=True, eq=False)
class Signs(Own):
    @staticmethod
    def step(p, s, x):
        return x * s.a, P(1.0 - s.a)


def test_what_needs_float64_is_refused_by_name(tmp_path):
    x, way = Input("x", "m"), {"x": 1.0 + 1e-6 * np.sin(np.arange(100) / 7)}
    near = (2.0 * x - stimlib.constant(2.0, "m")) * stimlib.constant(5.0, "N/m")
    k = Param("k", 1e30)  # its square is beyond float32, and no sample has it
    for scene, says, *params in (
        (Scene({"y": near}), "more than 0.001 of its peak 1e-05, first after Sub.Mul."),
        (Scene({"y": k * k * near}), "first after Sub.Mul.", ("k", 1.0)),
        (Scene({"y": elapsed() * x}), "Time..: in float32 a count ends at 2.24"),
        *(
            (Scene({"y": cls(x)}), f"{cls.__name__}.step: in float32 a count ends at 2.24")
            for cls in (Turns, Pairs, Adds)
        ),
        (Scene({"y": Words(x)}), "Words.tile: 64-bit words take the room of two float32"),
        (Scene({"y": friction(x, 20.0)}), "ElastoPlastic.*: 1e.100 is beyond float32"),
    ):
        how = {"params": dict(params)} | NARROW
        error = refused(SceneError, says, export_c, scene, 1000, tmp_path, way, **how)
        assert not list(tmp_path.iterdir()), error
        assert ".py:" not in str(error) or "test_export_float32.py:" in str(error)
    export_c(Scene({"y": Signs(x)}), 1000, tmp_path, way, **NARROW)  # which does not grow


def test_differences_of_both_signs_count():
    found = differences(np.array([[1.0, 0.0], [3.0, 0.0]]), np.array([[2.0, 0.0], [-4.0, 1.0]]))
    assert found == [(0.5**0.5, 1.0, 2.0), (5.0, 7.0, 4.0)]


def test_the_error_is_measured_with_a_compiler_of_this_machine(tmp_path, monkeypatch):
    scene, way = Scene({"y": 2.0 * Input("x")}), {"x": np.ones(100)}
    monkeypatch.setenv("CC", "gcc -DSTIM_NONE")
    assert export_c(scene, 1000, tmp_path, way, **NARROW).errors == {"y": (0.0, 0.0, 2.0)}
    monkeypatch.setenv("CC", "gcc -ffast-math")
    says = "without -ffast-math"
    refused(SinkError, says, export_c, scene, 1000, tmp_path, way, **NARROW)
    monkeypatch.setenv("PATH", str(tmp_path))
    says = "needs a C compiler here"
    refused(MissingPackage, says, export_c, scene, 1000, tmp_path, way, **NARROW)


AUDIO = """
#include <stdint.h>
#include <stdio.h>
#define AUDIO_SAMPLE_RATE_EXACT 44100.0f
#define AUDIO_BLOCK_SAMPLES 128
struct audio_block_t { int16_t data[AUDIO_BLOCK_SAMPLES]; };
struct AudioStream {
    AudioStream(int, audio_block_t **) {}
    virtual void update() = 0;
    audio_block_t block;
    audio_block_t *allocate() { return &block; }
    void transmit(audio_block_t *b, int)
    {
        for (int i = 0; i < AUDIO_BLOCK_SAMPLES; i++) printf("%d\\n", b->data[i]);
    }
    void release(audio_block_t *) {}
};
struct AudioOutputI2S {};
struct AudioConnection {
    AudioConnection(AudioStream &from, int, AudioOutputI2S &, int) { first() = &from; }
    static AudioStream *&first() { static AudioStream *s; return s; }
};
static struct { int available() { return 0; } int read() { return 0; } } Serial;
static void AudioMemory(int) {}
static void AudioNoInterrupts() {}
static void AudioInterrupts() {}
static int analogRead(int) { static int k; return (k += 60) > 1000 ? 1000 : k; }
void setup();
void loop();
int main()
{
    setup();
    for (int k = 0; k < 30; k++) { loop(); AudioConnection::first()->update(); }
}
"""


@pytest.mark.skipif(not shutil.which("g++"), reason="g++ is not installed")
def test_the_sketch_of_the_how_to_sends_the_samples_of_the_processor(tmp_path):
    scene, safety = SHIPPED["click"](), Safety(8.0)
    export_c(scene, 44100, tmp_path, {"x": np.zeros(441)}, "click", 0.01, safety=safety, **NARROW)
    (tmp_path / "Audio.h").write_text(AUDIO)
    sketch = Path(__file__).parents[1] / "examples" / "teensy" / "teensy.ino"
    words = ["g++", "-std=c++17", "-Wall", "-Werror", "-I.", "-x", "c++", sketch, "click.c"]
    subprocess.run([*words, "-o", "sketch"], cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "sketch"], capture_output=True, text=True).stdout
    ends = 4e-3 / 1023 * np.minimum(60 * np.arange(31), 1000)
    x = np.interp(np.arange(1, 30 * 128 + 1), 128 * np.arange(31), ends)
    proc = stimlib.compile(protect(scene, safety), 44100)
    proc.set("sink_gain", 1.0, ramp=0.02)
    want = np.round(proc.process(x[None])[0] / 8.0 * 32767)
    assert np.abs(np.array(said.split(), int) - want).max() <= 1 and np.ptp(want) > 5000
