"""Scenes that hold every block of the table, exported as C and compiled."""

import math
import subprocess
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from contract import TABLE

from stimlib import Block, Input, Scene, SceneError
from stimlib.blocks.noise import deviates
from stimlib.core import maths
from stimlib.core.maths import each, pairs
from stimlib.export import export_c
from stimlib.motion import parse_motion
from stimlib.scenes import ROWS, SHIPPED

FAST = ["gcc", "-std=c99", "-O0"]
GCC = ["gcc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"]


MOST, COUNT = 40, 8  # blocks of one scene, and scenes
LARGE = ("mode_shape",)  # its table takes 16 MB of text: the last group, of the stress tests


@cache
def groups():
    """(rate, scene, motion of its inputs): together they have every entry of the table.

    Blocks of one scene must have different noises and names, so there are several. They
    take seconds: for a test to ask for, not a file that is imported.
    """
    left, found = sorted(TABLE, key=lambda e: e.name in LARGE), []
    while left:
        outputs, motion, others = {}, {}, []
        fs = left[0].rates[0]
        for e in left:
            inputs = [Input(f"{e.name}_{name}", e.unit) for name in e.inputs]
            try:
                full = len(outputs) == MOST or (e.name in LARGE and outputs)
                if fs not in e.rates or full:
                    raise SceneError("in the next group")
                block = e.make(*inputs)
                Scene(outputs | {e.name: block})
            except SceneError:
                others.append(e)
                continue
            outputs[e.name] = block
            motion |= {i.name: row for i, row in zip(inputs, e.x(1200, fs), strict=True)}
        scene = Scene(outputs)
        wave = np.sin(np.arange(1200) / 30)  # of inputs that an entry makes itself
        found.append((fs, scene, {name: motion.get(name, wave) for name in scene.inputs}))
        left = others
    return found


def compared(folder, name, compiler, run=(), options=("-lm",)):
    """What the self test of an exported scene prints, compiled and run so."""
    sources = [f"{name}.c", f"{name}_test.c"]
    program = folder / f"{name}.exe"
    subprocess.run([*compiler, *sources, "-o", program, *options], cwd=folder, check=True)
    return subprocess.run([*run, program], cwd=folder, capture_output=True, text=True).stdout


def same(folder, name, samples, compiler=FAST, run=(), options=("-lm",)):
    """Whether all samples of a self test have the bits of the processor."""
    return compared(folder, name, compiler, run, options) == f"0 of {samples} samples differ\n"


def exported(k, folder):
    """Export a group of the table; return how many samples its self test compares."""
    fs, scene, motion = groups()[k]
    return export_c(scene, fs, folder, motion, f"group{k}", 0.15).samples


def shipped(name, folder, seconds=0.25, **words):
    """Export a scene of the library with its motion."""
    motion = {n: parse_motion(m) for n, m in ROWS[name].drive.items()}
    return export_c(SHIPPED[name](), 8000, folder, motion, name, seconds, **words)


# Every node that a step or a tile may have ------------------------------------------
U = np.uint64
SMALL, LEAST, GREAT, NONE, MANY = -0.0, -math.inf, math.inf, math.nan, 2**40
BIT, POSITIVE = U(2**63 + 5), U(2**63 - 1)


class Numbers(NamedTuple):
    """Of every kind: floats, words, arrays of both, and arrays without elements."""

    gain: float
    seed: np.uint64
    table: np.ndarray
    masks: np.ndarray
    none: np.ndarray


class Memory(NamedTuple):
    """State of every kind, with names that C does not take."""

    double: float
    n: np.uint64
    st_line: np.ndarray
    register: np.ndarray
    none: np.ndarray


class Three(NamedTuple):
    low: float
    high: float
    chosen: np.uint64


def split(x, by=3.0, less=-1.0):
    """With defaults, and with the arguments of a NamedTuple in another order."""
    return Three(high=x / by + 40.5, chosen=maths.bits(x) >> U(3), low=x - less)


def none_of(v):
    """With a truth value, and of an empty tuple."""
    return v


def powered(p, a):
    return a * a - 1.0


class Scale(NamedTuple):
    gain: float
    by: float


def scaled(p, a, b):
    return p.gain * a - p.by * b


@dataclass(frozen=True, eq=False)
class EveryNodeOfAStep(Block):
    """A step that has all operators, and values at which they are easily confused."""

    x: Block

    def design(self, fs):
        made = Numbers(
            0.75,
            U(0x9E3779B97F4A7C15),
            np.arange(6.0) ** 2 - 3.0,
            np.array([7, 1 << 63], U),
            np.ones(0),
        )
        return made, Memory(0.5, U(5), np.arange(5.0), np.array([1, 2**63 + 1, 3], U), np.ones(0))

    @staticmethod
    def step(p, s, x):
        double, st_word, index = (
            -x * p.gain,
            split(x, 7.0),
            np.int64(maths.floor(maths.where(abs(x) < 99.0, x, 0.0))),
        )
        k = index % 5 + -index % -3
        remainder = x % 2.5 + x % -2.5 + 1.0 / (-4.0 * maths.floor(x) % -2.0 + 4.0)
        y = remainder - st_word.low / st_word.high + p.table[index % 6] - p.table.size
        u = (s.n << U(7) ^ BIT) + (p.seed & st_word.chosen | p.masks[1]) % U(1000) * U(3)
        u -= s.register[index % 3] >> U(60)
        u ^= none_of(s.n) << U(9)
        c = (x >= 0.0) & (x != 1.5) | (x <= -2.0) ^ (x == -3.0)
        y += maths.where(c, 1.0, 2.0) + maths.where(-1.0 <= x < 1.0, 4.0, 0.0) * none_of(x > 0.25)
        y += maths.where((x > LEAST) & (x < GREAT), 8.0, 0.0) + maths.where(x != NONE, 16.0, 0.0)
        chosen = maths.where(x > 0.0, u, s.n)
        total, n_1 = 0, 3
        for i in range(n_1):
            total = total + s.st_line[i] * (i - 1)
        turn = 0  # a whole number at first */
        for _ in range(3):
            y += turn % 2 + none_of(k) + maths.sin(k) + powered((), x)
            turn = turn + 0.75
        for i in range(4, 0, -2):
            total += k * i % MANY
        far, below = s.n & U(127), index & 127  # no word has so many bits
        total += k % (index & 1) + (index << below) + (index >> below + 60)
        for i in range(1, p.none.size + s.st_line.size):
            s.st_line[i] = 0.5 * s.st_line[i] + maths.fma(x, p.gain, double)
        s.register[1] = chosen ^ U(k + 9)
        y -= maths.flush(x * 1e-190) * 1e190 + abs(total)
        sign = (maths.bits(maths.flush(x * 1e-191)) ^ maths.bits(SMALL)) >> U(63)
        sign += maths.bits(x % -2.5) >> U(63)
        sign += (u << far ^ u >> far) + u % (far & U(1))  # by 0: 0
        y += maths.as_float(sign) + maths.unbits(maths.bits(x) & POSITIVE)
        return y, Memory(double, u + U(1), s.st_line, s.register, s.none)


@dataclass(frozen=True, eq=False)
class EveryNodeOfATile(Block):
    """A tile that has what a step has not: two outputs, branches, arrays as a whole."""

    outputs = ("y", "z")
    x: Block

    def units(self, *u):
        return u[0], u[0]

    def design(self, fs):
        return EveryNodeOfAStep.design(self, fs)

    @staticmethod
    def work(p):
        return 160  # 80 floats and 80 words

    @staticmethod
    def tile(p, s, x, y, z, w):
        n, line, key, odd = y.size, s.st_line, s.register, np.int64(s.n & U(1))
        halves = maths.words(w[80:])
        each(powered, (), (x,), y)
        each(scaled, Scale(p.gain, 1.5), (x, y), z)
        if n & 1 == 1 or x[0] > 1.0 and x[n - 1] > 1.0:
            pairs(deviates, p.seed, s.n >> U(1), w[: n + odd])
        else:
            pairs(deviates, p.seed, s.n >> U(1), w[: n + odd + 1])
        for i in range(n):
            y[i] += w[odd + i]
            halves[i] = (s.n + U(i)) * p.seed
            halves[i] |= key[1:][0]
        part, some = w[70:79], halves[70:75]
        w[65:80], halves[64:80] = 2.0, U(9)
        part[2:99], some[2:99] = 3, p.seed
        w[70:72], halves[70:72] = line[1:3], key[1:3]
        maths.copy(line[:2], w[67:])
        w[75:74] = line[3:2]
        total = part[7:5].size + some[4:3].size + part[20:99].size + some[2:99].size
        for i in range(65, 80):
            total = total * 0.5 + w[i] + maths.as_float(halves[i] >> U(40))
        total += maths.as_float(maths.words(w[65:])[1] >> U(52))  # of 2.0
        for i in range(n):
            if x[i] > 1.0 and x[i] < 3.0 or x[i] < -5.0:
                z[i] += 0.5
            else:
                z[i] -= 0.25
        for i in range(n):
            z[i] += maths.as_float((halves[i] ^ p.seed) >> U(40)) + total
        return Memory(s.double, s.n + U(n), line, key, s.none)
