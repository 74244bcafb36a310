"""The noise chain of the squeeze with its stages, and numpy + scipy as a peer.

Both do the same work for each sample, from the same filter design.  The peer runs in
chunks that fit in the cache, keeps its states between chunks, and reuses its memory.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import NamedTuple

import numpy as np
from scipy import signal
from timing import fastest

from stimlib.blocks import differentiator, pink_noise, pinking, white_noise
from stimlib.core.graph import Block, Input
from stimlib.core.scene import Scene
from stimlib.design.filters import differentiator_taps
from stimlib.design.noise import noise_modes
from stimlib.run.processor import Processor, compile

Job = Callable[[], object]
FS, BLOCK, SAMPLES = 8000.0, 8192, 1 << 19
CHUNKS = (4096, 8192, 16384, 32768, 65536)  # of the peer
F_LOW, TOL_DB, PASSBAND, STOPBAND = 10.0, 0.01, 1000.0, 1500.0
ROWS = 64  # of the peer's matrix product

# Operations a sample, each at the price of one FMA: what the definitions of the blocks
# cannot do without. White, for two samples: Philox and its words 103, the radius 28 (a
# division and a square root count 1 each), the turn 34, 2 products.  Pink, with 8
# modes: an FMA into each state and one out of it, 7 adds of the tree, 5 for d, TINY and
# silence. Differentiator: 129 taps in eights, 7 adds.
WHITE = (103 + 28 + 34 + 2) / 2
PINK = 8 * 2 + 7 + 5
FIR = 136 + 7


class Stage(NamedTuple):
    """A stage of the noise chain as a scene, with the implementations to compare."""

    scene: Scene
    peers: dict[str, Job]
    operations: float
    """Operations per sample; ``peak(operations * samples)`` is the limit."""


def design() -> tuple[np.ndarray, np.ndarray]:
    """Return the sections (n, 6) and taps (129,) that all peers use.

    The sections are those of the pink filter, and the taps those of the differentiator.
    """
    m = noise_modes(FS, F_LOW, TOL_DB)
    poles = 1 - m.e
    numerator = m.d * np.poly(poles)
    for k in range(poles.size):
        numerator = numerator + m.r[k] * np.r_[np.poly(np.delete(poles, k)), 0.0]
    sos = signal.zpk2sos(np.roots(numerator), poles, numerator[0])
    return sos, differentiator_taps(FS, PASSBAND, STOPBAND, 128).taps


class Peer:
    """The noise chain in numpy and scipy, in chunks, with three ways to run the taps.

    Parameters
    ----------
    chunk : int
        Samples at a time, a multiple of 64.
    way : str
        One of ``WAYS``.
    """

    def __init__(self, chunk: int, way: str = "convolve"):
        self.sos, self.taps = design()
        self.rng, self.zi = np.random.Generator(np.random.PCG64(1)), np.zeros((len(self.sos), 2))
        h = self.taps.size - 1
        self.w, self.line = np.zeros(chunk), np.zeros(h + chunk)
        self.run_taps = {
            "convolve": self._convolve,
            "oaconvolve": self._oaconvolve,
            "matrix": self._matrix,
        }[way]
        windows = np.lib.stride_tricks.sliding_window_view(self.line, h + ROWS)[::ROWS]
        self.windows, self.parts, self.y = (
            windows,
            np.empty(windows.shape),
            np.empty((chunk // ROWS, ROWS)),
        )
        self.matrix = np.zeros((h + ROWS, ROWS))
        for k in range(ROWS):
            self.matrix[k : k + h + 1, k] = self.taps[::-1]

    def _convolve(self) -> np.ndarray:
        return np.convolve(self.line, self.taps, "valid")

    def _oaconvolve(self) -> np.ndarray:
        return signal.oaconvolve(self.line, self.taps, "valid")

    def _matrix(self) -> np.ndarray:
        np.copyto(self.parts, self.windows)
        return np.matmul(self.parts, self.matrix, out=self.y).ravel()

    def white(self) -> np.ndarray:
        """Return the next chunk of white noise."""
        return self.rng.standard_normal(out=self.w)

    def pink(self, w: np.ndarray) -> np.ndarray:
        """Return the next chunk of noise, filtered to -3 dB/octave."""
        y, self.zi = signal.sosfilt(self.sos, w, zi=self.zi)
        return y

    def fir(self, x: np.ndarray) -> np.ndarray:
        """Return the next chunk of noise, differentiated."""
        h = self.taps.size - 1
        self.line[h:] = x
        y = self.run_taps()
        self.line[:h] = self.line[-h:].copy()
        return y


WAYS = {"convolve": "np.convolve", "oaconvolve": "oaconvolve", "matrix": "matrix product"}


def stages(samples: int = SAMPLES) -> dict[str, Stage]:
    """Return all stages and the whole chain, with the peers of each.

    Parameters
    ----------
    samples : int
        Samples per job of a peer; a multiple of every one of ``CHUNKS`` that is not
        longer.

    Returns
    -------
    dict of str to Stage
        Each peer with all chunk lengths (and all ways to run the taps);
        ``fastest_peer`` finds the best.
    """
    x, given = Input("x"), np.random.default_rng(0).standard_normal(max(CHUNKS))
    lengths = [c for c in CHUNKS if c <= samples]

    def repeated(chunk: int, way: str, part: Callable[[Peer], object]) -> Job:
        peer = Peer(chunk, way)

        def job() -> None:
            for _ in range(samples // chunk):
                part(peer)

        return job

    def peers(name: str, part: Callable[[Peer], object]) -> dict[str, Job]:
        return {
            f"{name}, chunks of {chunk}": repeated(chunk, "convolve", part) for chunk in lengths
        }

    def by_ways(name: str, part: Callable[[Peer], object]) -> dict[str, Job]:
        return {
            f"{name}{text}, chunks of {c}": repeated(c, way, part)
            for way, text in WAYS.items()
            for c in lengths
        }

    def diff(y: Block) -> Block:
        return differentiator(y, passband=PASSBAND, stopband=STOPBAND)

    pink = pink_noise(1 / pi, seed=1, f_low=F_LOW, tol_db=TOL_DB)
    return {
        "white noise": Stage(
            Scene({"y": white_noise(seed=1)}), peers("numpy PCG64", Peer.white), WHITE
        ),
        "pink filter": Stage(
            Scene({"y": pinking(x, f_low=F_LOW, tol_db=TOL_DB)}),
            peers("scipy sosfilt", lambda p: p.pink(given[: p.w.size])),
            PINK,
        ),
        "pink noise": Stage(
            Scene({"y": pink}), peers("numpy + scipy", lambda p: p.pink(p.white())), WHITE + PINK
        ),
        "differentiator": Stage(
            Scene({"y": diff(x)}), by_ways("", lambda p: p.fir(given[: p.w.size])), FIR
        ),
        "noise chain": Stage(
            Scene({"y": diff(pink)}),
            by_ways("numpy + scipy, ", lambda p: p.fir(p.pink(p.white()))),
            WHITE + PINK + FIR,
        ),
    }


def fastest_peer(stage: Stage, rounds: int = 3) -> dict[str, Job]:
    """Return the fastest peer of a stage on this machine, under its name."""
    name = fastest(stage.peers, rounds)
    return {name: stage.peers[name]}


# Scenes that run ----------------------------------------------------------------------
def puller(
    scene: Scene, x: np.ndarray | None = None, samples: int = SAMPLES, fs: float = FS
) -> Job:
    """Return a job that streams a scene in blocks of 8192 samples.

    Parameters
    ----------
    scene : Scene
    x : ndarray, optional
        Inputs, shape (n_inputs, samples); a single row is used for all inputs. By
        default they are 0.
    samples : int
    fs : float
        In Hz.
    """
    proc = compile(scene, fs)
    x = np.zeros((1, samples)) if x is None else np.atleast_2d(x)
    x = (
        np.broadcast_to(x, (len(proc.inputs), x.shape[1]))
        if proc.inputs
        else np.empty((0, samples))
    )
    blocks = [np.ascontiguousarray(x[:, a : a + BLOCK]) for a in range(0, x.shape[1], BLOCK)]
    outs = {n: np.empty((len(proc.outputs), n)) for n in {b.shape[1] for b in blocks}}

    def job() -> None:
        proc.reset()
        for b in blocks:
            proc.process(b, outs[b.shape[1]])

    return job


def movements(samples: int = SAMPLES, fs: float = FS) -> dict[str, np.ndarray]:
    """Return positions in m for a gate that is open, open in bursts, or closed."""
    t = np.arange(samples) / fs
    return {
        "gate open": 0.1 * t,
        "0.5 s bursts": 0.1 * np.minimum(t % 1.0, 1.0 - t % 1.0),
        "gate closed": np.zeros(samples),
    }


# Single calls -------------------------------------------------------------------------
def caller(proc: Processor, x: np.ndarray, n: int) -> Job:
    """Return a job of many calls of ``process(x, out)`` with n samples each.

    Parameters
    ----------
    proc : Processor
    x : ndarray, shape (n_inputs, samples)
    n : int
        Samples per call.
    """
    parts = [np.ascontiguousarray(x[:, a : a + n]) for a in range(0, x.shape[1] - n + 1, n)]
    out, process = np.empty((len(proc.outputs), n)), proc.process

    def job() -> None:
        for part in parts:
            process(part, out)

    return job
