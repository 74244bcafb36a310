"""How fast stimlib is on this machine, in less than a minute, and a picture of it.

    python benchmarks/short.py             print
    python benchmarks/short.py --record    and keep both

The figures are kept in results/short.csv, the picture in docs/pictures/speed.svg.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from bench import TIMES, Job, Row, options, row, save
from matplotlib import rc_context
from matplotlib.figure import Figure
from noise_chain import FS, SAMPLES, caller, fastest_peer, movements, puller, stages
from peak import peak
from timing import interleaved, machine, medians, ratio

from stimlib.blocks import springpot
from stimlib.core.graph import Input
from stimlib.core.scene import Scene
from stimlib.run.processor import compile
from stimlib.scenes import bumps, squeeze

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "speed.svg"
HOUR = 3_600_000  # samples at 1 kHz
CALLS = 10_000


class Speed(NamedTuple):
    """The time of a job, with that of its peer and the core's limit if known."""

    what: str
    ns: float
    """Nanoseconds per sample of each output, median."""
    peer: str = ""
    peer_ns: float | None = None
    times: float | None = None
    """Time of the peer relative to stimlib: the median of the ratios within a round."""
    share: float | None = None
    """Fraction of the limit, which is the time of the same number of independent FMAs.
    """


def measure(rounds: int = 9) -> list[Speed]:
    """The noise chain, a springpot, the shipped scenes and single calls."""
    found = []
    for name, stage in stages().items():
        peer = fastest_peer(stage, min(rounds, 3))
        found.append(
            _beside(
                name,
                puller(stage.scene),
                peer,
                SAMPLES,
                rounds,
                peak(stage.operations * SAMPLES),
            )
        )
    found.append(_beside("springpot, 1e-10, 1 h at 1 kHz", *_springpot(HOUR), HOUR, min(rounds, 5)))
    moves = movements()
    jobs: dict[str, Job] = {
        f"squeeze, 2 fingers, {gate}": puller(squeeze(), x) for gate, x in moves.items()
    }
    jobs["bumps, sine"] = puller(bumps("sine"), 0.1 - np.abs(moves["gate open"] % 0.2 - 0.1))
    found += [
        Speed(what, seconds / SAMPLES * 1e9)
        for what, seconds in medians(interleaved(jobs, rounds)).items()
    ]
    one = {
        f"one sample a call, {gate}": caller(
            compile(squeeze(), FS), np.tile(moves[gate][:CALLS], (2, 1)), 1
        )
        for gate in ("gate open", "gate closed")
    }
    return found + [
        Speed(what, seconds / CALLS * 1e9)
        for what, seconds in medians(interleaved(one, rounds)).items()
    ]


def _beside(
    what: str, ours: Job, peers: dict[str, Job], n: int, rounds: int, limit: Job | None = None
) -> Speed:
    (peer,) = peers
    times = interleaved({"": ours} | peers | ({"limit": limit} if limit else {}), rounds)
    middle = medians(times)
    share = ratio(times, "limit", "") if limit else None
    return Speed(
        what, middle[""] / n * 1e9, peer, middle[peer] / n * 1e9, ratio(times, peer, ""), share
    )


def _springpot(n: int, alpha: float = 0.4) -> tuple[Job, dict[str, Job]]:
    """Return jobs for a springpot and for the full Gruenwald-Letnikov sum by FFT."""
    from scipy.signal import oaconvolve

    y = 0.01 * np.sin(2 * np.pi * np.arange(n) / 1000)
    j = np.arange(1, n)
    d, weights = np.diff(y, prepend=y[0]), 1000**alpha * np.cumprod(np.r_[1.0, (j - alpha) / j])
    scene = Scene({"f": springpot(Input("y", "m"), 1.0, alpha, "gl", tol=1e-10)})
    return puller(scene, y, fs=1000.0), {"scipy oaconvolve": lambda: oaconvolve(d, weights)[:n]}


def picture(speeds: list[Speed], path: Path) -> None:
    """The figures, one row each, in nanoseconds per sample on a log axis."""
    fig = Figure(figsize=(9, 0.9 + 0.36 * len(speeds)), layout="constrained")
    ax = fig.subplots()
    rows = range(len(speeds))
    ax.plot([s.ns for s in speeds], rows, "o", color="C0", label="stimlib", zorder=3)
    peers = [(k, s, s.peer_ns) for k, s in enumerate(speeds) if s.peer_ns is not None]
    ax.plot(
        [ns for _, _, ns in peers],
        [k for k, _, _ in peers],
        "s",
        color="C1",
        label="numpy + scipy at their best",
        zorder=3,
    )
    limits = [(k, s.ns * s.share) for k, s in enumerate(speeds) if s.share is not None]
    ax.plot(
        [v for _, v in limits],
        [k for k, _ in limits],
        "|",
        color="0.3",
        ms=12,
        mew=2,
        label="limit of the core",
    )
    for k, s, ns in peers:
        ax.plot([s.ns, ns], [k, k], color="0.7", zorder=1)
        words = {"textcoords": "offset points", "va": "center", "fontsize": "small"}
        ax.annotate(f"{s.times:.1f} times as long", (max(s.ns, ns), k), xytext=(8, 0), **words)
    ax.set(
        xscale="log",
        xlabel="nanoseconds a sample, one core",
        yticks=rows,
        yticklabels=[s.what for s in speeds],
    )
    ax.set_ylim(len(speeds) - 0.5, -0.5)
    ax.grid(alpha=0.3)
    ax.legend(
        loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=3, frameon=False, fontsize="small"
    )
    fig.supxlabel(machine(), fontsize=6, color="0.4")
    with rc_context({"svg.fonttype": "none"}):  # words stay words
        fig.savefig(path)


def rows_of(s: Speed) -> list[Row]:
    """A figure, and what stands beside it."""
    rows = [row(s.what, s.ns)]
    if s.peer_ns is not None and s.times is not None:
        rows += [
            row(f"{s.what}: {s.peer}", s.peer_ns),
            row(f"{s.what}: ratio: {s.peer} / stimlib", s.times, TIMES),
        ]
    return (
        rows if s.share is None else [*rows, row(f"{s.what}: share of the limit", s.share, TIMES)]
    )


def main() -> None:
    given = options(__doc__).parse_args()
    speeds = measure()
    save("short", [row(machine()), *(r for s in speeds for r in rows_of(s))], given.record)
    if given.record:
        picture(speeds, PICTURE)


if __name__ == "__main__":
    main()
