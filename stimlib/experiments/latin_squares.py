"""Squares: orders that balance conditions over places and participants.

In a Graeco-Latin square each condition meets each place, each participant and each
second condition once. In a Williams square each condition follows each other one
equally often.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import BadValue, Several, public

_POLYNOMIALS = {4: 0b111, 8: 0b1011, 16: 0b10011, 32: 0b100101}  # irreducible over GF(2)

# order: where the second is at the border, then the two first rows without it; found by
# search, see _bordered
_BORDERED = {
    10: (6, (8, 5, 4, 3, 0, 2, 7, 1), (3, 5, 1, 8, 6, 2, 7, 0)),
    14: (8, (1, 6, 11, 9, 12, 5, 4, 10, 2, 8, 7, 0), (9, 12, 7, 4, 1, 8, 0, 6, 2, 5, 11, 3)),
    18: (
        14,
        (12, 14, 13, 6, 4, 3, 11, 15, 10, 1, 9, 8, 2, 0, 7, 16),
        (10, 3, 1, 14, 0, 13, 9, 8, 15, 6, 16, 11, 7, 5, 2, 4),
    ),
    22: (
        1,
        (13, 17, 6, 15, 1, 20, 5, 12, 9, 18, 10, 4, 14, 19, 0, 11, 3, 7, 16, 8),
        (0, 1, 6, 5, 17, 2, 15, 14, 16, 19, 3, 10, 8, 18, 12, 9, 7, 20, 13, 4),
    ),
    26: (
        23,
        (22, 1, 14, 4, 7, 23, 19, 11, 10, 17, 21, 5, 18, 2, 13, 6, 0, 24, 8, 15, 12, 16, 20, 3),
        (5, 4, 15, 20, 13, 11, 24, 6, 16, 0, 10, 9, 2, 14, 21, 12, 1, 3, 22, 8, 7, 23, 18, 19),
    ),
    30: (
        14,
        (
            6,
            9,
            27,
            17,
            3,
            14,
            10,
            26,
            0,
            21,
            28,
            8,
            12,
            23,
            19,
            22,
            11,
            1,
            5,
            20,
            13,
            7,
            4,
            25,
            18,
            16,
            24,
            15,
        ),
        (
            24,
            10,
            8,
            18,
            15,
            12,
            16,
            26,
            22,
            0,
            9,
            13,
            5,
            2,
            11,
            28,
            4,
            6,
            23,
            14,
            21,
            20,
            7,
            3,
            1,
            27,
            19,
            25,
        ),
    ),
}


@public
def graeco_latin(n: int) -> NDArray[np.int64]:
    """Return a Graeco-Latin square of an order.

    Parameters
    ----------
    n : int
        3 to 32, not 6: of the orders 2 and 6 there is none (Tarry 1900).

    Returns
    -------
    ndarray of int, shape (n, n, 2)
        [place in the order, participant] -> (Greek, Latin), each 0 to n - 1; it has
        gone through `check_graeco_latin`.

    Raises
    ------
    BadValue
        Another order; the message says why.

    Notes
    -----
    Odd n: i + j and 2 i + j modulo n. Powers of 2: the same in the field GF(n),
    products of the two for multiples of 4 (Bose 1938). Other even n: squares that go on
    along their diagonals, with a border (Wanless 2004, Diagonally cyclic Latin squares,
    European Journal of Combinatorics 25, 393-413).

    Examples
    --------
    The references and permutations of four participants (as in Çaldıran's thesis, table
    3.1, with another square):

    >>> from stimlib.experiments import graeco_latin
    >>> for row in graeco_latin(4):
    ...     print(*("".join(pair) for pair in ((str(g), "ABCD"[k]) for g, k in row)))
    0A 1B 2C 3D
    1C 0D 3A 2B
    2D 3C 0B 1A
    3B 2A 1D 0C
    """
    if not isinstance(n, int) or not 3 <= n <= 32 or n == 6:
        why = "there is none of that order" if n in (2, 6) else "the orders known here are 3 to 32"
        raise BadValue(
            f"graeco_latin({n!r}): {why}; take one that has a square, such as {5 if n == 6 else 4}"
        )
    even = n & -n  # the largest power of 2 in n
    square = _bordered(n) if even == 2 else _product(_field(even), _cyclic(n // even))
    check_graeco_latin(square)
    return square


@public
def check_graeco_latin(square: ArrayLike) -> None:
    """Raise BadValue, with the place, unless a square is Graeco-Latin.

    Each letter must be once in each row and column, and each pair once in all.

    Parameters
    ----------
    square : array, shape (n, n, 2)

    Examples
    --------
    Table 3.1 of Çaldıran's thesis is one:

    >>> from stimlib.experiments import check_graeco_latin
    >>> table = "bA gD zB tC", "gB bC tA zD", "zC tB bD gA", "tD zA gC bB"
    >>> check_graeco_latin(
    ...     [
    ...         [("bgzt".index(g), "ABCD".index(k)) for g, k in row.split()]
    ...         for row in table
    ...     ]
    ... )
    """
    s = np.asarray(square)
    if s.ndim != 3 or s.shape[0] != s.shape[1] or s.shape[2] != 2:
        raise BadValue(f"a Graeco-Latin square must have the shape (n, n, 2), got {s.shape}")
    n = len(s)
    for k, letters in enumerate(("Greek", "Latin")):
        for what, lines in (("row", s[:, :, k]), ("column", s[:, :, k].T)):
            for i, line in enumerate(lines):
                if sorted(line.tolist()) != list(range(n)):
                    raise BadValue(
                        f"{what} {i + 1} has not each {letters} letter once: {line.tolist()}"
                    )
    pairs, counts = np.unique(s.reshape(-1, 2), axis=0, return_counts=True)
    if len(pairs) != n * n:
        twice = pairs[counts > 1][0].tolist()
        raise BadValue(
            f"the pair {twice} is there {counts.max()} times: the two Latin squares are not"
            " orthogonal"
        )


@public
def williams(n: Several) -> NDArray[np.int64]:
    """Return orders that are balanced for first-order carry-over.

    Source: Williams 1949, Australian Journal of Scientific Research A 2, 149-168.

    Parameters
    ----------
    n : int
        Conditions, 2 to 1000.

    Returns
    -------
    ndarray of int, shape (n, n) where n is even, (n, 2 n) where it is odd
        [place in the order, participant] -> condition, 0 to n - 1. Each condition
        comes once in each order, equally often at each place, and directly after each
        other condition once (even n) or twice (odd n).

    Raises
    ------
    BadValue
        Another number of conditions.

    Examples
    --------
    The orders of four participants, one a line:

    >>> from stimlib.experiments import williams
    >>> for order in williams(4).T:
    ...     print(*("ABCD"[k] for k in order))
    A B D C
    B C A D
    C D B A
    D A C B
    >>> williams(3).shape
    (3, 6)
    """
    k = np.arange(n)
    first = np.where(k % 2, (k + 1) // 2, -(k // 2)) % n  # 0, 1, n - 1, 2, n - 2 ..
    square = (first[:, None] + k) % n
    return np.hstack([square, square[::-1]]) if n % 2 else square


def _cyclic(n: int) -> NDArray[np.int64]:
    i, j = np.indices((n, n))
    return np.stack([(i + j) % n, (2 * i + j) % n], axis=-1)


def _field(n: int) -> NDArray[np.int64]:
    """Return i + j and x i + j in GF(n), n = 1 or a power of 2 from 4 on."""
    i, j = np.indices((n, n))
    times_x = np.where(2 * i < n, 2 * i, 2 * i ^ _POLYNOMIALS.get(n, 0)) if n > 1 else i
    return np.stack([i ^ j, times_x ^ j], axis=-1)


def _product(a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the product of two squares, whose letters are pairs of letters."""
    n, m = len(a), len(b)
    return (m * a[:, None, :, None] + b[None, :, None, :]).reshape(n * m, n * m, 2)


def _bordered(n: int) -> NDArray[np.int64]:
    """Return two squares that go on along their diagonals, with a border.

    Cell (i, j) = i + f(j - i) modulo n - 1; the border has the rest.

    Of f, f(d) and f(d) - d are each all numbers but one: these go to the last column
    and the last row. The two squares are orthogonal because the differences of their f,
    with those of the border, are all numbers once.
    """
    g = n - 1
    at, *rows = _BORDERED[n]
    squares = []
    for hole, values in zip((0, at), rows, strict=True):
        f = np.insert(np.array(values), hole, -1)
        d = np.delete(np.arange(g), hole)
        i, j = np.indices((g, g))
        inner = np.where((j - i) % g == hole, g, (i + f[(j - i) % g]) % g)
        right, below = (next(iter(set(range(g)) - set(v.tolist()))) for v in (f[d], (f[d] - d) % g))
        square = np.full((n, n), g)
        square[:g, :g] = inner
        square[:g, g] = (np.arange(g) + right) % g
        square[g, :g] = (np.arange(g) + below) % g
        squares.append(square)
    return np.stack(squares, axis=-1)
