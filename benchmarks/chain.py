"""The noise chain of the squeeze, whole and its stages, against those who can do the
same, and against the core's limit.

    python benchmarks/chain.py             print
    python benchmarks/chain.py --record    and keep the figures in results/chain.csv

Peers: numpy + scipy in the chunk and the form that is fastest here
(noise_chain.py), the JAX target; Faust where faust and g++ are installed;
pyplnoise, colorednoise, pedalboard and pyo where Python finds them, each for what it
can express.  The limit is the time of as many independent FMAs as a stage has
operations.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable
from pathlib import Path

import faust
import numpy as np
from bench import TIMES, Row, compared, main, row, under
from noise_chain import (
    F_LOW,
    FS,
    SAMPLES,
    Stage,
    design,
    fastest_peer,
    movements,
    puller,
    stages,
)
from peak import peak
from timing import fastest, interleaved, medians, ratio

import stimlib
from stimlib.scenes import squeeze

Job = Callable[[], object]
OURS, LIMIT = "stimlib", "as many FMAs"


def jax_target(stage: Stage) -> dict[str, Job]:
    """The whole signal in one call, in both precisions."""
    import jax

    found = {}
    for dtype in ("float64", "float32"):
        f = stimlib.compile(stage.scene, FS, "jax", dtype=dtype)
        found[f"JAX target, {dtype}"] = lambda f=f: jax.block_until_ready(f(n=SAMPLES))
    return found


def pyplnoise(stage: Stage) -> dict[str, Job]:
    """A cascade of filters on numpy's noise, in blocks."""
    from pyplnoise import PinkNoise

    source = PinkNoise(FS, F_LOW, FS / 2)
    return {"pyplnoise": lambda: [source.get_series(8192) for _ in range(SAMPLES // 8192)]}


def colorednoise(stage: Stage) -> dict[str, Job]:
    """The whole signal by one FFT."""
    from colorednoise import powerlaw_psd_gaussian

    return {"colorednoise, whole signal": lambda: powerlaw_psd_gaussian(1, SAMPLES, F_LOW / FS)}


def pedalboard(stage: Stage) -> dict[str, Job]:
    """The taps alone, by FFT, in float32."""
    from pedalboard import Convolution, Pedalboard

    taps = design()[1]
    board = Pedalboard(
        [Convolution((taps / np.abs(taps).sum()).astype(np.float32)[None], sample_rate=FS)]
    )
    x = np.random.default_rng(0).standard_normal((1, SAMPLES)).astype(np.float32)
    return {"pedalboard, float32": lambda: board.process(x, FS)}


def pyo(stage: Stage) -> dict[str, Job]:
    """Its 64-bit server by hand, in blocks of 512; its white noise is uniform."""
    with contextlib.redirect_stdout(io.StringIO()):
        import pyo64

        server = pyo64.Server(sr=FS, nchnls=1, buffersize=512, duplex=0, audio="manual").boot()
        server.start()
        sos, taps = design()
        parts = [pyo64.Noise()]
        for b0, b1, b2, _, a1, a2 in sos.tolist():
            parts.append(pyo64.Biquada(parts[-1], b0=b0, b1=b1, b2=b2, a0=1, a1=a1, a2=a2))
        table = pyo64.DataTable(size=taps.size, init=taps.tolist())
        parts.append(pyo64.Convolve(parts[-1], table, size=taps.size).out())

    def job(keep=(parts, table)) -> None:
        for _ in range(SAMPLES // 512):
            server.process()

    return {"pyo, uniform noise": job}


OPTIONAL = {
    "pink noise": (pyplnoise, colorednoise),
    "differentiator": (pedalboard,),
    "noise chain": (jax_target, pyo),
}


def stage_rows(name: str, stage: Stage, others: dict[str, Job]) -> list[Row]:
    """A stage against numpy + scipy, who else can do it, and its limit."""
    rows, peers = [], fastest_peer(stage) | others
    for make in OPTIONAL.get(name, ()):
        try:
            peers |= make(stage)
        except ImportError:
            rows.append(row(f"{make.__name__} is not installed"))
    jobs = {OURS: puller(stage.scene)} | peers | {LIMIT: peak(stage.operations * SAMPLES)}
    times = interleaved(jobs)
    found = [row(what, seconds / SAMPLES * 1e9) for what, seconds in medians(times).items()]
    found += [row(f"ratio: {peer} / {OURS}", ratio(times, peer, OURS), TIMES) for peer in peers]
    return under(name, [*found, row("share of the limit", ratio(times, LIMIT, OURS), TIMES), *rows])


def gate_rows() -> list[Row]:
    """The two-finger squeeze by what its gate does."""
    jobs = {what: puller(squeeze(), x) for what, x in movements().items()}
    return under("squeeze, two fingers", compared(jobs, SAMPLES, "0.5 s bursts"))


def measure() -> list[Row]:
    """All rows."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        others: dict[str, Job] = {}
        if faust.missing():
            rows.append(row(f"noise chain: Faust: {faust.missing()} is not installed"))
        else:
            made = faust.jobs(Path(folder), SAMPLES)
            others = {(best := fastest(made)): made[best]}
        for name, stage in stages().items():
            rows += stage_rows(name, stage, others if name == "noise chain" else {})
    return [*rows, *gate_rows()]


if __name__ == "__main__":
    main("chain", __doc__, measure)
