"""Fuzz the readers of files: ``run.py SECONDS [READER ...]``, or with coverage as a
guide ``run.py --guided SECONDS READER``.

Each input that breaks the promise is kept in cases/READER, and from then on ``make
test`` tries it.  With --guided it needs atheris (``pip install atheris``) and stops at
the first one; else it goes on and tells all of them.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import resource
import sys
import time
import traceback
import warnings
from pathlib import Path

GIGABYTES = 3  # of addresses, beyond what the packages take when they are imported


def keep(name: str, data: bytes) -> str:
    from fuzz.readers import CASES

    path = CASES / name / hashlib.sha256(data).hexdigest()[:12]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return f"{name}/{path.name}"


def limit() -> None:
    """So little memory that an input cannot take much: what asks for more fails."""
    with open("/proc/self/statm") as f:
        pages = int(f.read().split()[0])
    most = pages * resource.getpagesize() + GIGABYTES * 10**9
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))


def run(seconds: float, names: list[str], seed: int) -> int:
    """Mutate good files at random, the readers in turn; how many inputs broke the
    promise, each place counted once.
    """
    from fuzz.mutations import mutated
    from fuzz.readers import READERS, attempt

    warnings.simplefilter("error")
    chance = random.Random(seed)
    seeds = {name: READERS[name].seeds() for name in names}
    for name in names:
        for data in seeds[name]:
            attempt(name, data)
    limit()
    count, places = dict.fromkeys(names, 0), {}
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        name = names[sum(count.values()) % len(names)]
        data = mutated(chance.choice(seeds[name]), name, chance.randrange)
        count[name] += 1
        try:
            attempt(name, data)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            frames = traceback.extract_tb(error.__traceback__)
            ours = [f for f in frames if "stimlib" in f.filename and "fuzz" not in f.filename][
                -1:
            ] or frames[-1:]
            place = (name, type(error).__name__, ours[0].filename, ours[0].lineno)
            if place not in places:
                places[place] = keep(name, data)
                where = f"{Path(ours[0].filename).name}:{ours[0].lineno}"
                print(
                    f"{places[place]}: {where}: {type(error).__name__}: {str(error)[:200]!r}",
                    flush=True,
                )
    inputs = ", ".join(f"{name} {n}" for name, n in count.items())
    print(f"seed {seed}: inputs {inputs}; {len(places)} broken places")
    return len(places)


def guided(seconds: float, name: str) -> None:
    import atheris

    with atheris.instrument_imports(
        include=["stimlib.devices", "stimlib.core.scene", "stimlib.blocks", "csv", "zipfile"]
    ):
        from fuzz.mutations import mutated
        from fuzz.readers import CASES, READERS, attempt
    seeds = READERS[name].seeds()
    for data in seeds:
        attempt(name, data)
    warnings.simplefilter("error")

    def change(data: bytes, most: int, seed: int) -> bytes:
        return mutated(data, name, random.Random(seed).randrange)[:most]

    def one(data: bytes) -> None:
        try:
            attempt(name, data)
        except Exception:
            print(keep(name, data), flush=True)
            raise

    corpus = CASES.parent / "corpus" / name
    corpus.mkdir(parents=True, exist_ok=True)
    for i, data in enumerate(seeds):
        (corpus / f"seed{i}").write_bytes(data)
    words = [
        sys.argv[0],
        f"-max_total_time={seconds:g}",
        "-max_len=20000",
        "-rss_limit_mb=4000",
        "-timeout=60",
        str(corpus),
    ]
    atheris.Setup(words, one, custom_mutator=change)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--guided", action="store_true")
    parser.add_argument("--seed", type=int, default=time.time_ns() % 10**6)
    parser.add_argument("seconds", type=float)
    parser.add_argument("readers", nargs="*")
    given = parser.parse_args()
    if not 0 < given.seconds < float("inf"):
        parser.error(f"{given.seconds:g} seconds: a number above 0")
    if given.guided:
        if len(given.readers) != 1:
            parser.error("--guided changes the files of one reader: give its name")
        guided(given.seconds, given.readers[0])
    else:
        from fuzz.readers import READERS

        if unknown := [name for name in given.readers if name not in READERS]:
            parser.error(f"no reader {', '.join(unknown)}; there are {', '.join(READERS)}")
        sys.exit(run(given.seconds, given.readers or list(READERS), given.seed) > 0)
