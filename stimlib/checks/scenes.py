"""The laws of whole scenes: which apply to a scene, and users' own.

Each law is computed from the motion, the live parameters and the arguments of the
scene. ``SCENES`` has them by the name that a scene carries; they are written in
``families``. None of them looks into the graph under test, so a wrong number in a
scene's function is detected. Where a law needs a noise, or a wait that a rounding
decides, it makes the block of its own.
"""

from __future__ import annotations

import copy
import dataclasses as dc
import inspect
import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from ..analysis.recursion import all_pole
from ..core.graph import Const
from ..core.parts import OWN, Part, known
from ..errors import BadValue, counted
from . import (
    families as families,  # it enters laws of scenes into ``SCENES``
)
from .evidence import SCENES, Asked, Check, Evidence, SceneLaw, asked, worst

OWN_TOL = 1e-9  # of the largest value, where a law of a user's own states none
SUMMED = 1e-15  # of the sum of sizes, the rounding of each term
ONWARD = {"squeeze": 0, "bumps": 1, "grating": 1, "pulse": 1, "tone": 1, "wall": 1}
"""Laws that go on from one stretch of a long recording to the next, and how many
samples before it they must see.
"""
STARTS = dict.fromkeys(
    ("bump_grid", "bumps", "touch_screen", "ultrasonic_friction"), {"A": "amplitude"}
)
"""Arguments that set a parameter of another name."""


def scene_law(e: Evidence) -> list[Check]:
    """Return the reference-law checks of a scene's parts."""
    if not e.scene.parts:
        e.skipped.append("no law of the whole scene is known")
    known_laws = _known_laws(e)
    last, sums = e, list[Check]()
    for s in e.stretches() if known_laws else ():
        for part, law, kept, found in known_laws:
            if _begins(part, s) or (s.at and part.span is None and part.law in ONWARD):
                lines = len(s.numbers), len(s.skipped)
                _worst(found, _checks_of(_led(s, last, part), part, law, kept))
                if part.span and s.end < min(
                    e.frames, round((part.span.start + part.span.duration) * e.fs)
                ):
                    s.skipped.append(
                        f"{part.name or part.law}: of its interval only what is before"
                        f" {s.end / e.fs:.6g} s is held"
                    )
                if s.at and part.span:
                    e.numbers += s.numbers[lines[0] :]
                    e.skipped += s.skipped[lines[1] :]
        _worst(sums, [*_sums(s)])
        last = s
    return [*(c for *_, found in known_laws for c in found), *sums]


def _sums(e: Evidence) -> Iterator[Check]:
    """Check outputs against the sum of what laws give for their terms."""
    for name, y in zip(e.scene.outputs, e.y, strict=True):
        terms = [k for k in e.wanted if isinstance(k, tuple) and k[0] == name]
        found = [(*k[1][1:], *e.wanted.pop(k)()) for k in terms]
        if found and len(found) < found[0][1]:
            e.skipped.append(
                f"{name}: no law here for {found[0][1] - len(found)} of its {found[0][1]} terms,"
                " so their sum was not compared"
            )
        elif found:
            n, most = y.size, SUMMED * len(found)
            want = sum(w * row[-n:] for w, _, row, _ in found)
            tol = sum(
                abs(w) * (np.broadcast_to(tol, row.shape)[-n:] + most * np.abs(row).max())
                for w, _, row, tol in found
            )
            e.wanted[name] = partial(tuple, (want, tol))
            text = f"of the laws of its {len(found)} terms, with their tolerances"
            yield Check("d", f"{name}: sum", *worst(y - want, tol), text)


def _known_laws(e: Evidence) -> list[tuple[Part, SceneLaw, dict[str, Any], list[Check]]]:
    """Return the parts that can be checked, each with its law and a list for results.

    For the others, the evidence records why not.
    """
    laws_of = {
        part.law: SCENES.get(part.law, own_law if known(part.law) else None)
        for part in e.scene.parts
    }
    e.unknown[:] = [name for name, law in laws_of.items() if law is None]
    known_laws: list[tuple[Part, SceneLaw, dict[str, Any], list[Check]]] = []
    for part in e.scene.parts:
        law, called = laws_of[part.law], f"{part.name}: the law" if part.name else "the law"
        if law is None:
            where = (
                "import its module first (--import FILE.py)"
                if "." in part.law
                else "no shipped scene has it; update stimlib"
            )
            e.skipped.append(f"{called} {part.law!r} is not known here: {where}")
        elif part.given is None:
            e.skipped.append(
                f"{called} {part.law!r} needs what the scene was asked for, which was not kept"
                " before stimlib 0.2"
            )
        else:
            known_laws.append((part, law, {}, []))
            if e.end < e.frames and part.span is None and part.law not in ONWARD:
                e.skipped.append(
                    f"{called}: held against the first {e.end / e.fs:.6g} s only, as it needs all"
                    " samples at once"
                )
    return known_laws


def _begins(part: Part, e: Evidence) -> bool:
    """Return whether a part starts in this stretch."""
    first = min(round(part.span.start * e.fs), e.frames) if part.span else 0
    return e.at <= first < e.end or first == e.frames == e.end


def _led(e: Evidence, last: Evidence, part: Part) -> Evidence:
    """Return a stretch with the sample before it, if a law needs that."""
    if not e.at or part.span or not ONWARD[part.law]:
        return e
    rows: dict[str, Any] = {
        n: np.hstack([getattr(last, n)[:, -1:], getattr(e, n)]) for n in ("x", "y", "shown")
    }
    rows["terms"] = {key: np.r_[last.terms[key][-1], row] for key, row in e.terms.items()}
    return dc.replace(e, at=e.at - 1, led=1, **rows)


def _worst(found: list[Check], new: list[Check]) -> None:
    """Keep the worst result of each check among several stretches.

    It is the result nearest to its limit, or farthest beyond it.
    """
    if not found:
        found += new
        return
    for c in new:
        at = next((k for k, f in enumerate(found) if (f.group, f.name) == (c.group, c.name)), None)
        if at is None:
            found.append(c)
        elif _over(c) > _over(found[at]):
            found[at] = c


def _over(c: Check) -> float:
    """Return what was measured, divided by its limit."""
    return (
        c.measured / c.limit
        if c.limit and np.isfinite(c.measured)
        else 0.0
        if c.passed
        else math.inf
    )


def _checks_of(e: Evidence, part: Any, law: SceneLaw, kept: dict[str, Any]) -> list[Check]:
    try:
        a = asked(e, part, kept)
        if not a.n:
            e.skipped.append(f"{part.name or part.law}: none of its interval was displayed")
            return []
        known = dict.fromkeys(part.inputs or e.scene.params)
        named = {n: STARTS.get(part.law, {}).get(n, n) for n in known}
        begins = {
            n: a.given[key]
            for n, key in named.items()
            if key in a.given and part.inputs.get(n, n) in e.scene.params
        }
        return [*([a.begins(begins)] if begins else []), *law(a)]
    # whatever a user's law raises, and what a file may say that nobody was asked for
    except Exception as error:
        if part.law in OWN:
            raises = "" if isinstance(error, BadValue) else f" raises {type(error).__name__}"
            raise BadValue(f"the law {part.law}{raises}: {error}") from error
        why = f"not what the law {part.law!r} is for ({error or type(error).__name__})"
        return [
            Check(
                "d",
                f"{part.name}: shape of the scene" if part.name else "shape of the scene",
                1,
                0,
                why,
            )
        ]


def own_law(a: Asked) -> list[Check]:
    """Check a user's own law.

    It is a function of inputs, parameters and sample rate that returns the expected
    outputs.
    """
    p = {
        own: a.live(own)
        for own in a.part.inputs or a.e.params
        if a.part.inputs.get(own, own) in a.e.params
    }
    x = {own: row.view() for own, row in a.x.items()}
    for row in x.values():
        row.flags.writeable = False  # the law of another output, and the figures, have the same row
    law = OWN[a.part.law][0]
    words = {"seed": a.seed} if "seed" in inspect.signature(law).parameters else {}
    words |= copy.deepcopy({n: v for n, v in a.given.items() if n not in p})
    wanted = law(x, p, a.fs, **words)
    if (
        not isinstance(wanted, dict)
        or not wanted
        or (unknown := [name for name in wanted if name not in a.y])
    ):
        got = (
            f"the outputs {', '.join(unknown)}"
            if isinstance(wanted, dict) and wanted
            else repr(wanted)[:80]
        )
        raise BadValue(
            f"it returned {got}; return a row for each output that it is about, of {', '.join(a.y)}"
        )
    a.e.skipped += [
        f"{a.title(name)}: {a.part.law} returns nothing for it"
        for name in a.y
        if name not in wanted
    ]
    checks = []
    for name, made in wanted.items():
        row, stated = _stated(name, made, a.y[name].shape)
        top = float(np.abs(row).max(initial=0.0)) or 1e-300
        tol = OWN_TOL * top if stated is None else stated
        a.expect(name, row, tol + a.slack * top)
        far = worst(a.y[name] - row, tol + a.slack * top, a.window)
        text = "the law that came with the scene"
        checks.append(Check("d", f"{a.title(name)}: {a.part.law}", *far, text))
    return checks


def _stated(name: str, made: Any, shape: tuple[int, ...]) -> tuple[np.ndarray, Any]:
    """Return an output's row and tolerance as a user's law gives them, checked."""
    if isinstance(made, tuple) and len(made) != 2:
        raise BadValue(
            f"{name} is a tuple of {len(made)}; return a row, or a row and its tolerance"
        )
    values, limit = made if isinstance(made, tuple) else (made, None)
    if np.iscomplexobj(values):
        raise BadValue(f"{name} has complex values; return real ones")
    row = np.asarray(values, float)
    if row.shape != shape:
        raise BadValue(f"{name} has the shape {row.shape}; return {counted(shape[0], 'sample')}")
    if not np.isfinite(row).all():
        raise BadValue(f"{name} has values that are not finite; return finite ones")
    if limit is None:
        return row, None
    tol = np.asarray(limit)
    if (
        tol.dtype.kind not in "iuf"
        or tol.shape not in ((), shape)
        or not (np.isfinite(tol) & (tol >= 0)).all()
    ):
        raise BadValue(
            f"{name} has the tolerance {limit!r:.40}; return one finite number of 0 or above for"
            " all samples, or one for each"
        )
    return row, tol.astype(float)


def motor_limits(e: Evidence) -> list[Check]:
    """Check peak and running mean square of force-limited outputs.

    They are computed again from the samples.
    """
    from ..blocks.actuator import ForceLimit, StaticLimit

    tops = dict.fromkeys(e.scene.outputs, 0.0)
    means, states = tops.copy(), {name: np.zeros(1) for name in tops}
    for s in (
        e.stretches()
        if any(isinstance(b, StaticLimit | ForceLimit) for b in e.scene.outputs.values())
        else ()
    ):
        for y, (name, b) in zip(s.y, e.scene.outputs.items(), strict=True):
            tops[name] = np.fmax(tops[name], np.abs(y).max(initial=0.0))
            if isinstance(b, StaticLimit):
                a = -np.expm1(-1 / (b.tau * e.fs))
                mean, states[name] = all_pole(a, [a - 1], y**2, states[name])
                means[name] = max(means[name], float(mean.max(initial=0.0)))
    checks = []
    for name, b in e.scene.outputs.items():
        if isinstance(b, StaticLimit):
            text = "largest running mean square, N^2"
            checks.append(
                Check("e", f"{name}: static limit", means[name], b.limit**2 * (1 + 1e-12), text)
            )
            b = b.x
        if isinstance(b, ForceLimit) and isinstance(b.peak, Const):
            checks.append(Check("e", f"{name}: peak limit", float(tops[name]), b.peak.value, "N"))
    return checks
