"""The benchmarks of ``stimlib bench``, with table and picture."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..analysis.overview import check_place, save
from ..blocks import springpot
from ..core.graph import Input
from ..core.scene import Scene
from ..run.processor import compile
from ..scenes import bumps, squeeze
from ..system.packages import package
from .chain import FS, SAMPLES, Job, caller, fastest_peer, movements, puller, stages
from .peak import peak
from .timing import interleaved, machine, medians, ratio

if TYPE_CHECKING:
    from rich.table import Table

HOUR = 3_600_000  # samples at 1 kHz


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


def measure(samples: int = SAMPLES, hour: int = HOUR, rounds: int = 9) -> list[Speed]:
    """Measure the noise chain, a springpot, the shipped scenes and single calls.

    Parameters
    ----------
    samples : int
        Samples per job; a multiple of every ``stimlib.speed.chain.CHUNKS`` that is not
        longer.
    hour : int
        Samples of the springpot's job.
    rounds : int
        Number of times that each job is timed.

    Returns
    -------
    list of Speed

    Examples
    --------
    >>> from stimlib.speed.bench import measure
    >>> [s.what for s in measure(samples=4096, hour=1000, rounds=1)][:3]
    ['white noise', 'pink filter', 'pink noise']
    """
    found = []
    for name, stage in stages(samples).items():
        peer = fastest_peer(stage, min(rounds, 3))
        found.append(
            _beside(
                name,
                puller(stage.scene, samples=samples),
                peer,
                samples,
                rounds,
                peak(stage.operations * samples),
            )
        )
    found.append(_beside("springpot, 1e-10, 1 h at 1 kHz", *_springpot(hour), hour, min(rounds, 5)))
    moves = movements(samples)
    jobs: dict[str, Job] = {
        f"squeeze, 2 fingers, {gate}": puller(squeeze(), x) for gate, x in moves.items()
    }
    jobs["bumps, sine"] = puller(bumps("sine"), 0.1 - np.abs(moves["gate open"] % 0.2 - 0.1))
    found += [
        Speed(what, seconds / samples * 1e9)
        for what, seconds in medians(interleaved(jobs, rounds)).items()
    ]
    calls = min(samples, 10000)
    one = {
        f"one sample a call, {gate}": caller(
            compile(squeeze(), FS), np.tile(moves[gate][:calls], (2, 1)), 1
        )
        for gate in ("gate open", "gate closed")
    }
    return found + [
        Speed(what, seconds / calls * 1e9)
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
    scene = Scene({"f": springpot(Input("y", "m"), 1.0, alpha, tol=1e-10)})
    return puller(scene, y, fs=1000.0), {"scipy oaconvolve": lambda: oaconvolve(d, weights)[:n]}


def table(speeds: list[Speed]) -> Table:
    """Return the benchmark figures as a table for a terminal.

    Examples
    --------
    >>> from stimlib.speed.bench import Speed, table
    >>> table([Speed("white noise", 3.0, "numpy PCG64", 9.0, 3.0, 0.5)]).row_count
    1
    """
    from rich.table import Table
    from rich.text import Text

    out = Table(caption=Text(machine()), caption_justify="left")
    for column in (
        "",
        "ns a sample",
        "beside it",
        "ns a sample",
        "times as long",
        "share of the limit",
    ):
        out.add_column(
            column, justify="left" if column in ("", "beside it") else "right", no_wrap=column == ""
        )
    for s in speeds:
        ns, peer_ns, times, share = (
            "" if v is None else f"{v:.3g}" if v < 1000 else f"{v:.0f}"
            for v in s
            if not isinstance(v, str)
        )
        out.add_row(s.what, ns, s.peer, peer_ns, times, share)
    return out


def picture(speeds: list[Speed], path: str | os.PathLike) -> None:
    """Draw the figures, one row each, in nanoseconds per sample on a log axis.

    Parameters
    ----------
    speeds : list of Speed
    path : str or Path
        PNG, SVG or PDF, by its suffix.

    Raises
    ------
    SinkError
        The file cannot be written, or has another suffix.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from stimlib.speed.bench import Speed, picture
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "speed.png"
    >>> picture([Speed("white noise", 3.0, "numpy PCG64", 9.0, 3.0, 0.5)], path)
    >>> path.stat().st_size > 5000
    True
    """
    check_place(path)
    rc_context = package("matplotlib", "a picture").rc_context
    Figure = package("matplotlib.figure", "a picture").Figure
    fig: Any = Figure(figsize=(9, 0.9 + 0.36 * len(speeds)), layout="constrained")
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
        save(fig, path)
