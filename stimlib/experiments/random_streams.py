"""Random numbers by purpose, with an independent stream for each key of words.

Adding a condition does not change any other random draw.
"""

from __future__ import annotations

import hashlib

import numpy as np

from ..errors import BadValue, public


def _sequence(seed: int, words: tuple[str | int, ...]) -> np.random.SeedSequence:
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**64:
        raise BadValue(f"seed = {seed!r} must be a whole number from 0 to 2**64 - 1")
    key = hashlib.sha256("\0".join(map(str, words)).encode()).digest()
    return np.random.SeedSequence(seed, spawn_key=np.frombuffer(key, "<u4").tolist())


@public
def stream(seed: int, *words: str | int) -> np.random.Generator:
    """Return the random number generator for one purpose.

    Parameters
    ----------
    seed : int
        Seed of the session, 0 to 2**64 - 1.
    *words : str or int
        The purpose, such as ``"order", "noise", 12``.

    Returns
    -------
    numpy.random.Generator
        Philox, under a ``SeedSequence`` whose spawn key is the SHA-256 of the words.

    Raises
    ------
    BadValue
        The seed is invalid.

    Examples
    --------
    >>> from stimlib.experiments import stream
    >>> stream(1, "order").integers(10, size=4).tolist() == stream(1, "order").integers(
    ...     10, size=4
    ... ).tolist()
    True
    >>> bool(stream(1, "order").random() == stream(1, "start").random())
    False
    """
    return np.random.Generator(np.random.Philox(_sequence(seed, words)))


@public
def seed_of(seed: int, *words: str | int) -> int:
    """Return a 53-bit seed for one purpose, such as the noise of a trial.

    Parameters are as for `stream`.

    Examples
    --------
    >>> from stimlib.experiments import seed_of
    >>> seed_of(1, "noise", 3) == seed_of(1, "noise", 3) != seed_of(1, "noise", 4)
    True
    """
    return int(_sequence(seed, words).generate_state(1, np.uint64)[0] >> np.uint64(11))
