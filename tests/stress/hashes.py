"""Write the hashes of many renderings and states, or compare them with hashes that were
written before.

``python tests/stress/hashes.py new.json [old.json]`` renders every shipped scene, with
contact where it takes one, for two hands at four rates, compiled in one piece, in
blocks of 64 and of 37, and interpreted; then every block of the table of
``tests/contract.py``.  A change of the code that is to leave all samples alone is made
between two runs on one machine.
"""

import hashlib
import inspect
import json
import sys
import warnings
from collections.abc import Iterator

import numpy as np
from contract import TABLE
from laws import rows

import stimlib
from stimlib.motion.generators import minimum_jerk, sinusoid
from stimlib.scenes import SHIPPED

HANDS = {"sinusoid": sinusoid(0.02, 3.0), "minimum jerk": minimum_jerk()}
CUTS = (("llvm", None), ("llvm", 64), ("llvm", 37), ("python", None))


def sha(values: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()[:16]


def rendered(
    scene: stimlib.Scene, fs: float, x: np.ndarray, target: str, cut: int | None
) -> list[str]:
    """The hashes of samples and of state after a motion that is given in pieces, or the
    error's text.
    """
    try:
        processor = stimlib.compile(scene, fs, target, seed=5)
        cuts = range(0, x.shape[1], cut or x.shape[1])
        pieces = [processor.process(np.ascontiguousarray(x[:, i : i + cuts.step])) for i in cuts]
    except stimlib.StimlibError as e:
        return [str(e)]
    return [sha(np.concatenate(pieces, axis=1)), sha(processor.state)]


def motion(scene: stimlib.Scene, hand, t: np.ndarray) -> np.ndarray:
    values = [
        (np.sin(7 * t) > -0.4) * 1.0 if name == "contact" else hand(t) for name in scene.inputs
    ]
    return np.array(values).reshape(len(values), t.size)


def scenes() -> Iterator[tuple[str, list[str]]]:
    for name, make in SHIPPED.items():
        variants = {name: make()}
        if "contact" in inspect.signature(make).parameters:
            variants[f"{name} with contact"] = make(contact=True)
        for variant, scene in variants.items():
            for fs in (1000.0, 8000.0, 11025.0, 44100.0):
                for hand, f in HANDS.items():
                    x = motion(scene, f, np.arange(int(0.6 * fs)) / fs)
                    for target, cut in CUTS:
                        some = x[:, :160] if target == "python" else x
                        yield (
                            f"{variant}, {fs:g} Hz, {hand}, {target}, {cut}",
                            rendered(scene, fs, some, target, cut),
                        )


def blocks() -> Iterator[tuple[str, list[str]]]:
    for entry in TABLE:
        scene, fs = entry.scene(), entry.rates[0]
        x = rows(stimlib.compile(scene, fs, "python"), entry.x(4000, fs), entry.inputs)
        for target, cut in CUTS:
            some = x[:, :160] if target == "python" else x
            yield f"{entry.name}, {target}, {cut}", rendered(scene, fs, some, target, cut)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    found = dict([*scenes(), *blocks()])
    with open(sys.argv[1], "w") as file:
        json.dump(found, file, indent=0)
    print(len(found), "renderings,", sum(len(h) == 1 for h in found.values()), "of them refused")
    for path in sys.argv[2:]:
        with open(path) as file:
            before = json.load(file)
        other = sorted(k for k in before.keys() | found.keys() if before.get(k) != found.get(k))
        print(*other, f"{len(other)} differ from {path}", sep="\n")
        sys.exit(bool(other))
