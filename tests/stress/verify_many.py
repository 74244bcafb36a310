"""A thousand correct renderings, none of which may be refused, and every fault of
``tests/faults.py``, each of which must be.

    python tests/stress/verify_many.py [RENDERINGS] [FIRST_SEED]

Prints a line for each that is refused, and the table fault -> checks that caught it.
Exit status 1 if anything is wrong.
"""

import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from correct import rendering
from faults import FAULTS, caught

import stimlib


def main(count: int, first: int) -> int:
    # runs beyond a springpot's horizon are none of these
    warnings.simplefilter("ignore", RuntimeWarning)
    kinds, refused = Counter(), 0
    for seed in range(first, first + count):
        kind, scene, motion, given = rendering(np.random.default_rng(seed))
        report = stimlib.verify(scene, motion, given(scene, motion))
        kinds[kind] += 1
        if not report.passed:
            refused += 1
            print(
                f"REFUSED {seed} {kind}: {[c for c in report.checks if not c.passed]}", flush=True
            )
        if seed % 100 == 99:
            print(f"{seed + 1 - first} verified, {refused} refused", flush=True)
    print(f"{count} correct renderings, {refused} refused; {dict(kinds)}")
    missed = 0
    for name in FAULTS:
        with tempfile.TemporaryDirectory() as folder:
            by = caught(name, Path(folder))
        missed += not by
        print(f"{name}: {'; '.join(by) or 'MISSED'}", flush=True)
    print(f"{len(FAULTS)} faults, {missed} missed")
    return int(refused + missed > 0)


if __name__ == "__main__":
    sys.exit(main(*(int(v) for v in sys.argv[1:] + ["1000", "0"][len(sys.argv) - 1 :])))
