"""Ten thousand correct renderings of three scenes under recorded hands, none of which
may be refused: a sweep over ``verify``.

    python tests/stress/verify_sweep.py [RENDERINGS] [FOLDER]

With FOLDER, what is verified is kept there, and the next call with as many or more goes
on.  Prints a line for each that is refused or fails.  Exit status 1 if there is any, or
if fewer were seen than were asked for.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from hands import DATA, RECORDINGS

from stimlib.motion.recorded import recording
from stimlib.scenes import bumps, squeeze, viscoelastic
from stimlib.sweep import sweep

FS, SECONDS = 8000, 0.5


def hands(name: str) -> dict:
    """Every recorded hand as the motion of one input."""
    return {
        hand: recording(DATA / path, {name: column}, **words)
        for hand, (path, column, words) in RECORDINGS.items()
    }


def squeezes(fingers):
    return squeeze(fingers=fingers, contact=True)


def materials(alpha, scheme):
    return viscoelastic(alpha, scheme=scheme, contact=True)


def screens(wave, n, limit):
    return bumps(wave, n, limit=limit, contact=True)


def some(low, high):
    return lambda rng: rng.uniform(low, high)


def one_of(*values):
    return lambda rng: rng.choice(values)


SCENES = {
    squeezes: (
        "x",
        0.4,
        {
            "fingers": one_of(1, 2),
            "k": some(100, 5000),
            "A": one_of(0.0, 0.1, 3.4, 20.0),
            "level": some(0, 2),
        },
    ),
    materials: (
        "y",
        0.3,
        {
            "alpha": one_of(0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0),
            "scheme": one_of("gl", "l1"),
            "firmness": some(0.1, 3),
        },
    ),
    screens: (
        "x",
        0.3,
        {
            "wave": one_of("square", "sine", "sawtooth"),
            "n": one_of(2, 6, 18),
            "limit": one_of(120.0, 400.0),
            "freq": some(1, 900),
            "duty": some(0.05, 1),
        },
    ),
}
"""Scene: the input that the hand moves, its share of the renderings, and how its
columns are drawn.
"""


def main(count: int, folder: Path | None) -> int:
    seen = bad = 0
    for make, (name, share, columns) in SCENES.items():
        motion, n, rng = hands(name), round(share * count), np.random.default_rng(0)
        # one row after another, so that a longer table begins with the shorter one
        rows = [
            {
                **{c: draw(rng) for c, draw in columns.items()},
                "motion": sorted(motion)[i % len(motion)],
            }
            for i in range(n)
        ]
        table = {c: np.array([row[c] for row in rows]) for c in rows[0]} | {
            "seed": np.arange(n) % 97
        }
        out = folder / make.__name__ if folder else None
        done = sweep(make, table, motion=motion, measures="verify", fs=FS, seconds=SECONDS, out=out)
        wrong = [row for row in done.to_pylist() if row["verified"] != 1.0]
        for row in wrong:
            print(f"REFUSED {make.__name__} {row}", flush=True)
        seen, bad = seen + n, bad + len(wrong)
        print(f"{make.__name__}: {n} renderings, {len(wrong)} refused", flush=True)
    print(f"{seen} renderings, {bad} refused")
    return int(bad > 0 or seen < count)


if __name__ == "__main__":
    given = sys.argv[1:]
    sys.exit(main(int(given[0]) if given else 10_000, Path(given[1]) if len(given) > 1 else None))
