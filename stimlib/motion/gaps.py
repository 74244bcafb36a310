"""Missing numbers between the reports of a recording."""

from dataclasses import replace

import numpy as np

from .cells import Missing
from .pchip import cubics
from .reports import Reports
from .table import TableFile


def filled(table: TableFile, s: Reports, how: Missing, longest: float) -> tuple[Reports, list[str]]:
    """Return the reports without missing numbers, and what was done, in words.

    Numbers that are missing off contact are held. In contact, "interpolate" and "hold"
    bridge up to ``longest`` s, and "gap" takes contact away.
    """
    x, contact, every = s.x, s.contact, np.arange(len(s.t))
    notes = []
    for name, row in zip(s.inputs, x, strict=True):
        lost = np.isnan(row)
        if not lost.any():
            continue
        there = np.flatnonzero(~lost)
        if not len(there):
            raise table.error(f"there is no number for {name}", "use another column")
        k = np.maximum(np.searchsorted(there, every, "right") - 1, 0)
        before = there[k]
        after = there[np.minimum(np.searchsorted(there, every), len(there) - 1)]
        length = np.maximum(s.t[after], s.t) - np.minimum(s.t[before], s.t)
        touching = lost & s.contact
        bridged = float(length[touching].max(initial=0.0))
        if how == "gap":
            contact = contact & ~lost
        for i in np.flatnonzero(touching & (length > longest) & (how != "gap")):
            problem = f"{name} is missing for {length[i]:.6g} s, longer than {longest:.6g} s"
            remedy = f'say missing="gap", or max_gap={bridged * 1.001:.4g} to bridge it'
            raise table.error(problem, remedy, s.rows[i])
        values = row[before]
        if how == "interpolate":
            c = cubics(s.t[there], row[there], np.ones(len(there) - 1, dtype=bool))[:, k]
            u = np.clip(s.t, s.t[there[0]], s.t[there[-1]]) - s.t[before]
            values = ((c[0] * u + c[1]) * u + c[2]) * u + c[3]
        row[lost] = values[lost]
        done = {"gap": "no contact", "hold": "held", "interpolate": "interpolated"}[how]
        notes.append(f"{name}: {lost.sum()} missing numbers, {done}, {bridged:.4g} s at most")
    if not contact.any():
        raise table.error("a number is missing in every row", "use another column")
    return replace(s, contact=contact), notes
