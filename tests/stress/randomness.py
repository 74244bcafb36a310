"""Is the noise random?  Dieharder where it is installed, and scipy's tests of samples:
``make randomness``.

``randomness.py [--record] [--samples N]``.  What it says is a table, kept
with ``--record`` in docs/explanation/randomness.csv.  It ends with an error where a
p-value is below 1e-6: of two hundred, chance brings one in five thousand runs.  Where
its p-value is below 0.005 or above 0.995, dieharder draws more until that has passed or
failed for good.
"""

from __future__ import annotations

import argparse
import csv
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from itertools import count
from pathlib import Path
from typing import NamedTuple

import llvmlite
import numpy as np
import scipy
from scipy import fft, special, stats
from walked import compiled

import stimlib
from stimlib import Scene
from stimlib.blocks import noise, white_noise

TABLE = Path(__file__).parents[2] / "docs" / "explanation" / "randomness.csv"
FAILED = 1e-6
BLOCK = 1 << 18  # pairs of samples, 4 MiB of bits
U = np.uint64


class Row(NamedTuple):
    what: str
    test: str
    amount: str
    p: float
    said: str = ""


def told(row: Row) -> Row:
    print(f"{row.what:32} {row.test:52} {row.amount:>14} {row.p:9.2g} {row.said}", flush=True)
    return row


# Streams of bits ----------------------------------------------------------------------
@compiled
def words(keys: np.ndarray, first: np.uint64, out: np.ndarray) -> None:
    """The bits of pair first, first + 1, .. of each key in turn: four words of 32 bits
    each, as ``white_noise`` takes them.
    """
    for m in range(out.size // (2 * keys.size)):
        for k in range(keys.size):
            at = 2 * (m * keys.size + k)
            out[at], out[at + 1] = noise.pair_of_words(keys[k], first + U(m))


def bits_of(*sources: tuple[int, int]) -> Iterator[bytes]:
    """The bits behind the samples of white_noise(seed, stream), 128 of each source in
    turn, for ever.
    """
    keys = np.array([noise.noise_key(0, seed, stream, 0) for seed, stream in sources])
    out = np.empty((BLOCK // len(sources), len(sources), 2), U)
    for block in count():
        words(keys, U(block * len(out)), out.ravel())
        yield out.tobytes()


def samples_of(*sources: tuple[int, int]) -> Iterator[np.ndarray]:
    """Samples of white_noise(seed, stream), a row for each, as a processor makes
    them.
    """
    proc = stimlib.compile(Scene({f"n{k}": white_noise(*s) for k, s in enumerate(sources)}), 8000.0)
    while True:
        yield proc.process(np.empty((0, BLOCK)))


def uniform(*sources: tuple[int, int]) -> Iterator[bytes]:
    """Samples of each source in turn, through the normal distribution function: 32 bits
    of each.
    """
    for y in samples_of(*sources):
        yield (special.ndtr(y.T) * 2.0**32).astype(np.uint32).tobytes()


STREAMS: dict[str, Callable[[], Iterator[bytes]]] = {
    "bits of one noise": lambda: bits_of((1, 0)),
    "bits of seeds 0 to 255 in turn": lambda: bits_of(*((seed, 0) for seed in range(256))),
    "bits of streams 0 to 255 in turn": lambda: bits_of(*((1, stream) for stream in range(256))),
    "samples of two fingers in turn": lambda: uniform((0, 1), (0, 2)),
}

# Tests that dieharder itself calls good, but 17 (ten minutes each) and most lags of
# 203; and their sizes where one has several
DIEHARDER = {
    n: (0,) for n in (0, 1, 3, 4, 8, 9, 10, 11, 12, 13, 15, 16, 100, 204, 205, 206, 207, 208, 209)
} | {
    200: (1, 8),
    201: (2, 3),
    202: (3, 5),
    203: (0, 1, 3),
    2: (0,),
    101: (0,),
    102: (0,),
}


def dieharder(what: str, stream: Iterator[bytes], number: int, size: int) -> list[Row]:
    """One test on as much of a stream as it asks for; of what it said when it drew
    more, the last.
    """
    fields = [f"-D{f}" for f in ("test_name", "ntuple", "pvalues", "assessment", "no_whitespace")]
    program = ["dieharder", "-g200", "-Y1", f"-d{number}", f"-n{size}", "-c,", *fields]
    taken = 0
    with subprocess.Popen(program, bufsize=0, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as run:
        assert run.stdin and run.stdout
        try:
            for block in stream:
                run.stdin.write(block)
                taken += len(block)
        except BrokenPipeError:
            pass
        lines = [line.split(",") for line in run.stdout.read().decode().split()]
    last = {(name, ntuple): (float(p), said) for name, ntuple, p, said in lines}
    amount = f"{taken / 1e9:.2g} GB"
    return [
        told(Row(what, f"dieharder -d {number}: {name} {n}", amount, p, said))
        for (name, n), (p, said) in last.items()
    ]


# Samples ------------------------------------------------------------------------------
CELLS, SEGMENT, SIGMAS = 4096, 4096, (1, 2, 3, 4, 5, 6)


def two_sided(z: float) -> float:
    return float(2 * stats.norm.sf(abs(z)))


def of_samples(n: int) -> list[Row]:
    """Two fingers' noises: their distribution, tails and spectra, and what one knows of
    the other.
    """
    done, cells, beyond = 0, np.zeros((2, CELLS)), np.zeros((2, len(SIGMAS)))
    sums, power, cross = (
        np.zeros((2, 4)),
        np.zeros((2, SEGMENT // 2 + 1)),
        np.zeros(SEGMENT // 2 + 1, complex),
    )
    for y in samples_of((0, 1), (0, 2)):
        for k, row in enumerate(y):
            cells[k] += np.bincount(
                np.minimum(special.ndtr(row) * CELLS, CELLS - 1).astype(int), minlength=CELLS
            )
            beyond[k] += [np.sum(np.abs(row) > s) for s in SIGMAS]
            sums[k] += [np.sum(row**r) for r in (1, 2, 3, 4)]
        f = fft.rfft(y.reshape(2, -1, SEGMENT))
        power += np.sum(np.abs(f) ** 2, axis=1)
        cross += np.sum(f[0] * f[1].conj(), axis=0)
        done += y.shape[1]
        if done >= n:
            break
    segments, inner = done // SEGMENT, slice(1, -1)
    rows = []
    for k in (0, 1):
        what = f"samples of finger {k + 1}"
        p = {
            f"distribution: chi-square of {CELLS} equal parts": float(
                stats.chisquare(cells[k]).pvalue
            )
        }
        for s, found in zip(SIGMAS, beyond[k], strict=True):
            p[f"tail: {found:.0f} beyond {s} sigma"] = float(
                stats.binomtest(int(found), done, 2 * stats.norm.sf(s)).pvalue
            )
        for r, mean, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
            p[f"moment {r}"] = two_sided((sums[k, r - 1] / done - mean) * np.sqrt(done / variance))
        lines = stats.gamma.sf(power[k, inner] / SEGMENT, segments)
        p[f"spectrum: {lines.size} lines, Kolmogorov-Smirnov"] = float(
            stats.kstest(lines, "uniform").pvalue
        )
        p["spectrum: the largest line"] = float(-np.expm1(lines.size * np.log1p(-lines.min())))
        rows += [told(Row(what, test, f"{done:.2g} samples", value)) for test, value in p.items()]
    coherence = np.abs(cross[inner]) ** 2 / (power[0, inner] * power[1, inner])
    # of independent noises (Carter 1987, Proc. IEEE 75, 236, section II)
    lines = stats.beta.sf(coherence, 1, segments - 1)
    p = {
        f"coherence: {lines.size} lines, Kolmogorov-Smirnov": float(
            stats.kstest(lines, "uniform").pvalue
        ),
        "coherence: the largest line": float(-np.expm1(lines.size * np.log1p(-lines.min()))),
    }
    return rows + [
        told(Row("samples of two fingers", test, f"{done:.2g} samples", value))
        for test, value in p.items()
    ]


def of_bits(what: str) -> list[Row]:
    """All of dieharder on one stream: each test goes on where another has ended."""
    stream = STREAMS[what]()
    return [
        row
        for number, sizes in DIEHARDER.items()
        for size in sizes
        for row in dieharder(what, stream, number, size)
    ]


def jobs(samples: int) -> dict[str, Callable[[], list[Row]]]:
    """What is tested, each on its own."""
    if shutil.which("dieharder"):
        return {"samples of each finger": lambda: of_samples(samples)} | {
            what: partial(of_bits, what) for what in STREAMS
        }
    print(
        "dieharder is not installed (apt-get install dieharder): its tests are left out",
        file=sys.stderr,
    )
    return {"samples of each finger": lambda: of_samples(samples)}


def versions() -> str:
    text = (
        subprocess.run(["dieharder", "-l"], capture_output=True, text=True).stdout
        if shutil.which("dieharder")
        else ""
    )
    found = text.partition("version ")[2].split()[:1] or ["none"]
    names = {
        "stimlib": stimlib.__version__,
        "Python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
    said = [
        f"{name} {v}"
        for name, v in {**names, "llvmlite": llvmlite.__version__, "dieharder": found[0]}.items()
    ]
    return f"{datetime.now(UTC):%Y-%m-%d}, {platform.machine()}, {', '.join(said)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--record",
        type=Path,
        nargs="?",
        const=TABLE,
        metavar="FILE",
        help=f"keep the table (default: {TABLE.name})",
    )
    parser.add_argument(
        "--samples", type=float, default=2e8, help="of each finger (default: %(default)g)"
    )
    options = parser.parse_args()
    rows: list[Row] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(lambda job: job(), jobs(int(options.samples)).values()):
            rows += found
    if options.record:
        with options.record.open("w", newline="") as f:
            out = csv.writer(f, lineterminator="\n")
            out.writerows(
                (row.what, row.test, row.amount, f"{row.p:.2g}", row.said) for row in rows
            )
            out.writerow((versions(), "", "", "", ""))
    if wrong := [row for row in rows if row.p < FAILED or row.said == "FAILED"]:
        sys.exit(
            f"{len(wrong)} of {len(rows)} fail: " + "; ".join(f"{r.what}, {r.test}" for r in wrong)
        )
    print(f"none of {len(rows)} fails; {versions()}")


if __name__ == "__main__":
    main()
