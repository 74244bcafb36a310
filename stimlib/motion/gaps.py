"""Missing numbers between the reports of a recording."""

from dataclasses import replace

import numpy as np

from ..errors import counted
from .cells import Missing
from .pchip import cubics
from .reports import Reports
from .table import TableFile


def filled(table: TableFile, s: Reports, how: Missing, longest: float) -> tuple[Reports, list[str]]:
    """Return the reports without missing numbers, and what was done, in words.

    Numbers off contact are not looked at, and missing ones do not matter. In contact,
    "interpolate" and "hold" bridge up to ``longest`` s within a touch, and "gap" takes
    contact away, as a touch without any number does.
    """
    x, contact, every = s.x, s.contact, np.arange(len(s.t))
    touch = np.cumsum(np.diff(contact, prepend=False))
    notes = []
    for name, row in zip(s.inputs, x, strict=True):
        lost = np.isnan(row)
        if not lost.any():
            continue
        there = np.flatnonzero(~lost & s.contact)
        if not len(there):
            raise table.error(f"there is no number for {name}", "use another column")
        # the numbers around each row, those of its own touch if it has any
        low = np.maximum(np.searchsorted(there, every, "right") - 1, 0)
        high = np.minimum(np.searchsorted(there, every), len(there) - 1)
        k = np.where(touch[there[low]] == touch, low, high)
        before, after = there[k], there[np.where(touch[there[high]] == touch, high, low)]
        length = np.maximum(s.t[after], s.t) - np.minimum(s.t[before], s.t)
        touching, alone = lost & s.contact, touch[before] != touch
        length[alone], lone = 0.0, int((touching & alone).sum())
        bridged = float(length[touching].max(initial=0.0))
        contact = contact & ~(lost if how == "gap" else touching & alone)
        for i in np.flatnonzero(touching & (length > longest) & (how != "gap")):
            raise table.error(
                f"{name} is missing for {length[i]:.6g} s, longer than {longest:.6g} s",
                f'say missing="gap", or max_gap={bridged * 1.001:.4g} to bridge it',
                s.rows[i],
            )
        values = row[before]
        if how == "interpolate":
            c = cubics(s.t[there], row[there], np.diff(touch[there]) == 0)[:, k]
            u = np.maximum(s.t - s.t[before], 0.0)
            values = ((c[0] * u + c[1]) * u + c[2]) * u + c[3]
        row[lost] = values[lost]
        done = {"gap": "no contact", "hold": "held", "interpolate": "interpolated"}[how]
        notes.append(
            f"{name}: {lost.sum()} missing numbers, {done}, {bridged:.4g} s at most"
            + f"; no contact in {counted(lone, 'report')} of touches without a number" * (lone > 0)
        )
    if not contact.any():
        raise table.error("a number is missing in every row", "use another column")
    return replace(s, contact=contact), notes
