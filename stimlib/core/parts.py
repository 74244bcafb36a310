"""The parts of a scene: the reference law of each, its arguments, and its signals."""

from __future__ import annotations

import dataclasses as dc
import inspect
import os
import sys
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ..above import above
from ..errors import BadValue, SceneFileError, said_as
from ..system import fields
from .graph import Add, Block, Const, Div, Mul, Neg, Sub, reach
from .source import source_of

OWN: dict[str, tuple[Callable, str]] = {}
"""Laws of a user's own, and the text of their file, by the name that a scene file has
for them, as blocks are known by theirs.
"""


class Span(NamedTuple):
    """The interval of a trial in which a part is presented.

    The output is the part's scene, on a clock of its own, times a window with cosine
    ramps.
    """

    start: float  # s
    duration: float  # s
    ramp: float  # s
    seed: int | None  # of its noise; None: that of the run


class Term(NamedTuple):
    """Where a law's output stands in a sum, which is an output of the scene.

    ``path`` has the fields that lead from the sum to it: a and b of ``Add``, ``Sub``,
    ``Mul`` and ``Div``, x of ``Neg``.
    """

    path: str
    weight: float
    terms: int  # of the sum


@dc.dataclass(frozen=True)
class Part:
    """A scene, or one of several combined scenes, as its reference law needs it.

    Parameters
    ----------
    law : str
        Name of the function that made a shipped scene, or ``module.name`` of a law of a
        user's own.
    given : dict, optional
        The arguments that were given, as JSON data.  None: not known, as of scenes that
        were kept before 0.2.
    name : str
        Of the part, in a combined scene.
    inputs, outputs : dict of str to str
        What the scene calls each input or parameter, and each output, by the name that
        the law has for it; empty where these are the same.
    span : Span, optional
        Of an interval of a trial.
    terms : dict of str to Term
        Of each output that is a term of a sum, by the name that the law has for it.
    """

    law: str
    given: Mapping[str, Any] | None = None
    name: str = ""
    inputs: Mapping[str, str] = dc.field(default_factory=dict)
    outputs: Mapping[str, str] = dc.field(default_factory=dict)
    span: Span | None = None
    terms: Mapping[str, Term] = dc.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON data as a copy that the caller may change."""
        names = [f.name for f in dc.fields(self) if f.name != "terms" or self.terms]
        return {name: plain(getattr(self, name)) for name in names}

    @classmethod
    def from_dict(cls, data: Any, where: str) -> Part:
        """Read a part of a scene file; raise SceneFileError if it is invalid."""
        with said_as(SceneFileError, where, ValueError, TypeError, AttributeError):
            fields.require({"part": data}, {"part": TEST})
            if more := sorted(set(data) - {f.name for f in dc.fields(cls)}):
                raise ValueError(f"a law has no field {more[0]!r:.40}")
            kept(data["given"])
            terms = {name: Term(*term) for name, term in data.get("terms", {}).items()}
        span = Span(*data["span"]) if data["span"] else None
        return cls(**data | {"span": span, "terms": terms})

    def renamed(self, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> Part:
        """Return the part under the new names of inputs, parameters and outputs."""
        return dc.replace(
            self,
            inputs={k: inputs[name] for k, name in self.inputs.items()} or dict(inputs),
            outputs={k: outputs[name] for k, name in self.outputs.items()} or dict(outputs),
        )


MOST = 1e9  # s, of a span: 30 years


def _span(v: Any) -> bool:
    times = (
        isinstance(v, list)
        and len(v) == 4
        and all(fields.not_negative(t) and t < MOST for t in v[:3])
    )
    return times and (v[3] is None or fields.whole(2**64 - 1)(v[3]))


TEST = fields.record(
    {
        "law": fields.text,
        "given": fields.maybe(fields.table),
        "name": fields.text,
        "inputs": fields.table_of(fields.text),
        "outputs": fields.table_of(fields.text),
        "span": fields.maybe(fields.Test("start, duration, ramp and seed", _span)),
    }
)


def terms_of(law: Any, outputs: Mapping[str, Block]) -> tuple[Part, ...]:
    """Return the parts of a scene whose outputs are terms of these outputs.

    Terms may be added and subtracted, and multiplied or divided by a constant.
    """
    ends = [p.outputs or {n: n for n in law.outputs} for p in law.parts]
    own = {
        (k, n): id(signal(law.outputs[end], part.terms.get(n)))
        for k, part in enumerate(law.parts)
        for n, end in ends[k].items()
    }
    found: list[tuple[tuple[int, str], str, Term]] = []
    for end, root in outputs.items():
        leaves = {id(root): ("", 1.0)}
        for b in reversed(reach([root])):  # a sum comes before its terms
            gains = _gains(b) if id(b) in leaves and id(b) not in own.values() else []
            path, weight = leaves.pop(id(b)) if gains else ("", 0.0)
            for term, field, gain in gains:
                first, known = leaves.get(id(term), (path + field, 0.0))
                leaves[id(term)] = first, known + weight * gain
        found += [
            (key, end, Term(*leaves[at], len(leaves))) for key, at in own.items() if at in leaves
        ]
    if wrong := sorted({n for key in own if sum(key == f[0] for f in found) != 1 for n in key[1:]}):
        raise BadValue(
            f"law: {', '.join(wrong)} of {law!r:.80} must be a term of one output; add or subtract"
            " each once, multiplied or divided by a constant, or give another law"
        )
    return tuple(
        dc.replace(
            part,
            inputs=part.inputs or {n: n for n in law.inputs | law.params},
            outputs={n: end for (j, n), end, _ in found if j == k},
            terms={n: term for (j, n), _, term in found if j == k and term.path},
        )
        for k, part in enumerate(law.parts)
    )


def signal(b: Any, term: Term | None) -> Block:
    """Return the term of a sum; the sum itself if there is none."""
    return reduce(lambda b, name: getattr(b, name, b), term.path if term else "", b)


def _gains(b: Block) -> list[tuple[Block, str, float]]:
    """Return the terms of a sum or a multiple, each with its field and its factor."""
    match b:
        case Add(one, other):
            return [(one, "a", 1.0), (other, "b", 1.0)]
        case Sub(one, other):
            return [(one, "a", 1.0), (other, "b", -1.0)]
        case Neg(one):
            return [(one, "x", -1.0)]
        case Mul(Const(value), one):
            return [(one, "b", value)]
        case Mul(one, Const(value)):
            return [(one, "a", value)]
        case Div(one, Const(value)):
            return [(one, "a", 1 / value)] if value else []
    return []


def parts_of(law: Any, given: Mapping[str, Any] | None) -> tuple[Part, ...]:
    """Return the parts of a scene.

    ``law`` is nothing, a law's name, a function, or several parts; a name or a function
    has the arguments ``given``.
    """
    if law is None:
        if given:
            raise BadValue(
                f"given without a law: {given!r:.80} needs the law that it is for; give that as"
                " law="
            )
        return ()
    if isinstance(law, str):
        shipped = above("SHIPPED")
        if not (law in shipped or known(law)):
            raise BadValue(
                f"law = {law!r:.80} is not known; give one of {', '.join(shipped)}, or the function"
                " itself"
            )
        return (Part(law, kept(given)),)
    if callable(law):
        return (Part(_registered(law), kept({} if given is None else given)),)
    if isinstance(law, (tuple, list)) and all(isinstance(p, Part) for p in law):
        return tuple(law)
    raise BadValue(
        f"law = {law!r:.80} must be a name, or a function of the inputs, the parameters and the"
        " sample rate"
    )


def _registered(law: Callable) -> str:
    """Register a user's own law, and return its name."""
    name = f"{law.__module__}.{law.__qualname__}" if hasattr(law, "__qualname__") else ""
    if not name or "<lambda>" in name:
        raise BadValue(
            f"law = {law!r:.80} has no name that a file could keep; write it with def, and give"
            " numbers as given="
        )
    bound = hasattr(law, "__func__") and not isinstance(getattr(law, "__self__", None), type)
    if bound or inspect.isbuiltin(law) or getattr(law, "__closure__", None):
        raise BadValue(
            f"law = {name} uses values of the function around it, or of an object, which no"
            " file keeps; write it at the top of a module, and give numbers as given="
        )
    OWN[name] = law, source_of(law)  # now: the file may change while the function lives on
    return name


def kept(given: Any) -> Any:
    """Return the arguments of a law as JSON data.

    BadValue is raised for anything that is not a table, or is nested without end.
    """
    if not isinstance(given, Mapping | None):
        raise BadValue(
            f"given = {given!r:.80} is not a table; it must map names to values, such as"
            f" given={{'at':"
            " 0.01}"
        )
    try:
        return plain(given)
    except RecursionError:
        raise BadValue(
            "given: it is nested too deeply for a scene file; give tables and arrays of a few"
            " levels"
        ) from None


def known(law: str) -> bool:
    """Return whether a user's own law can be called here.

    It can if a scene was made with it, or if its module is already imported.

    A file is data and may come from anywhere, so the name in it can only stand for a
    law: a function that its module itself defines, with the first parameters ``x, p,
    fs``.
    """
    if law not in OWN:
        module, _, name = law.rpartition(".")
        f = getattr(sys.modules.get(module), name, None)
        if (
            inspect.isfunction(f)
            and f.__module__ == module
            and list(inspect.signature(f).parameters)[:3] == ["x", "p", "fs"]
        ):
            OWN[law] = f, source_of(f)
    return law in OWN


def plain(v: Any) -> Any:
    """Convert numbers, texts, arrays, tuples, tables and dataclasses to JSON data.

    Raises
    ------
    BadValue
        Something else, or a number that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from stimlib.core.parts import plain
    >>> plain({"a": np.float64(1.5), "b": (1, np.arange(3))})
    {'a': 1.5, 'b': [1, [0, 1, 2]]}
    """
    if isinstance(v, (np.ndarray, np.generic)):
        return plain(v.tolist())
    if (
        v is None
        or isinstance(v, (str, bool))
        or fields.number(v)
        or (isinstance(v, int) and abs(v) < 2**64)
    ):
        return v
    if isinstance(v, os.PathLike):
        return os.fspath(v)
    if isinstance(v, Mapping):
        return {str(name): plain(part) for name, part in v.items()}
    if isinstance(v, (tuple, list)):
        return [plain(part) for part in v]
    if dc.is_dataclass(v) and not isinstance(v, type):
        return {f.name: plain(getattr(v, f.name)) for f in dc.fields(v)}
    raise BadValue(
        f"given: {v!r:.80} cannot be kept in a scene file; give finite numbers, texts, arrays and"
        " tables of these"
    )
