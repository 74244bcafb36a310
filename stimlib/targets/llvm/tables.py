"""The loop over the cells of a large table, for ``motion.table``.

Its text is compiled once and kept, as that of ``runtime``.
"""

from stimlib.targets.llvm.values import exported


def byte(text, index):
    """Return a byte of words that hold eight each."""
    return (text[index >> 3] >> 8 * (index & 7)) & 255


@exported("i8", "i8*", "i8*", "i8", "i8", "i8", "f8*", "f8*")
def decimals(text, cells, rows, columns, column, powers, values):
    """Read the cells of a column, at most 15 digits; return how many are such.

    A row of ``cells`` is where it begins, and where each of its cells ends.
    """
    taken = 0
    for row in range(rows):
        start = cells[row * (columns + 1) + column] + (column > 0)
        end = cells[row * (columns + 1) + column + 1]
        if end > start:
            end -= byte(text, end - 1) == 13
        negative = byte(text, start) == 45
        number, digits, points, places = 0, 0, 0, 0
        for index in range(start + negative, end):
            digit = byte(text, index) - 48
            if digit >= 0 and digit < 10 and digits < 16:
                number, digits, places = 10 * number + digit, digits + 1, places + points
            elif digit == -2:
                points += 1
            else:
                digits = 16
        good = digits > 0 and digits < 16 and points < 2
        if good:
            values[row] = (1.0 - 2.0 * negative) * number / powers[places]
        taken += good
    return taken
