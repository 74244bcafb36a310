"""Scenes: named outputs, and the files that keep them."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ..above import above
from ..errors import SceneError, SceneFileError, StimlibError, UnknownName, need, public, said_as
from ..system import safe_files
from ..system.fields import strict
from ..system.limits import limits
from .graph import Block, Input, Named, as_block, check_name, reach, registry, signals, type_name
from .parameter import Param
from .parts import Part, parts_of, terms_of
from .program import Program, lower

VERSION = 2


@public
class Scene:
    """Named outputs of a graph: what a researcher writes, saves, compiles and shares.

    Parameters
    ----------
    outputs : dict of str to Block
    law : callable or str, optional
        What the outputs should be, for ``verify``: a function ``law(x, p, fs,
        **given)`` of the inputs and the parameters, two dictionaries with a row of
        samples for each, and of the sample rate in Hz.  It returns a dictionary with
        the wanted row of each output that it is about, or (row, tolerance), where the
        tolerance is one number or a row.  A law with a parameter ``seed`` gets that of
        the run.  Or the name of a shipped scene, whose law it is.  Or a scene whose
        outputs are terms of these: its laws then hold for each term, and their sum for
        the output.
    given : dict, optional
        What the scene was asked for: the numbers that the law needs besides, and by
        their names the values that parameters are to begin with.  They are kept in the
        scene's file.

    Raises
    ------
    SceneError
        No outputs; names used twice with different meaning; noise keys that collide.
    BadValue
        A law that is no function with a name, or a name that no shipped scene has;
        something given that a file cannot keep.

    Notes
    -----
    Two scenes are equal (``==``) if they have the same ``hash``, as a scene and what
    ``load`` reads from its file.  A law counts by its name, not by its text.

    Examples
    --------
    >>> from stimlib import Input, Param, Scene
    >>> Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})
    Scene(x [m], k [N/m] -> force [N])

    A scene with its law, which ``verify`` holds it against:

    >>> import stimlib
    >>> def spring(x, p, fs):
    ...     return {"force": p["k"] * x["x"]}
    >>> scene = Scene(
    ...     {"force": Param("k", 2000.0, "N/m") * Input("x", "m")}, law=spring
    ... )
    >>> motion = {"x": lambda t: 0.01 * t}
    >>> stimlib.verify(
    ...     scene, motion, stimlib.render(scene, motion, fs=1000, seconds=0.1)
    ... ).passed
    True
    """

    def __init__(
        self,
        outputs: Mapping[str, Block],
        law: str | Callable | Scene | Sequence[Part] | None = None,
        given: Mapping[str, Any] | None = None,
    ):
        if not isinstance(outputs, Mapping) or not outputs:
            raise SceneError('a scene needs named outputs, such as Scene({"force": force})')
        for name in outputs:
            check_name("output", name, SceneError)
        self.outputs: dict[str, Block] = {name: as_block(b) for name, b in outputs.items()}
        self.parts = parts_of(terms_of(law, self.outputs) if isinstance(law, Scene) else law, given)
        self._lowered: Any = None
        _ = self.program  # finds what is wrong with the graph now, where it was written

    def _known(self) -> tuple[list[tuple[str, int]], Program, list[Named]]:
        """Return outputs, program, and inputs and parameters, anew after a change."""
        known = [(name, id(b)) for name, b in self.outputs.items()]
        if self._lowered is None or self._lowered[0] != known:
            ends = [b for b in reach(self.outputs.values()) if isinstance(b, Named)]
            # with the outputs, or a later one could have the id of one that is gone
            self._lowered = known, lower(self.outputs), ends, [*self.outputs.values()]
        return self._lowered[:3]

    @property
    def program(self) -> Program:
        """The lowered program of the outputs, made once."""
        return self._known()[1]

    @property
    def inputs(self) -> dict[str, Input]:
        """Inputs by name, in the order of first use."""
        return {b.name: b for b in self._known()[2] if isinstance(b, Input)}

    @property
    def params(self) -> dict[str, Param]:
        """Parameters by name."""
        return {b.name: b for b in self._known()[2] if isinstance(b, Param)}

    def renamed(
        self,
        names: Mapping[str, str] | None = None,
        inputs: Mapping[str, str] | None = None,
        outputs: Mapping[str, str] | None = None,
    ) -> Scene:
        """Return the same scene with other names.

        Two stimuli of one kind then fit into one scene.

        Parameters
        ----------
        names, inputs, outputs : dict of str to str, optional
            New names of parameters, inputs and outputs by the old ones.

        Returns
        -------
        Scene
            With the same laws, under the new names.

        Raises
        ------
        UnknownName
            The scene has no such parameter, input or output.
        SceneError
            Two of a kind would have one name.
        BadValue
            No name that a parameter can have.

        Examples
        --------
        >>> from stimlib import Input, Param, Scene
        >>> Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")}).renamed(
        ...     {"k": "k_2"}
        ... )
        Scene(x [m], k_2 [N/m] -> force [N])
        """
        every = {}
        for what, asked, known in (
            ("parameter", names, self.params),
            ("input", inputs, self.inputs),
            ("output", outputs, self.outputs),
        ):
            need("renamed", asked or {}, known, what)
            every[what] = {name: (asked or {}).get(name, name) for name in known}
            if twice := [
                n for n in every[what].values() if list(every[what].values()).count(n) > 1
            ]:
                raise SceneError(
                    f"two {what}s would be called {twice[0]!r}; choose another name for one"
                )
        new: dict[int, Block] = {}
        for b in reach(self.outputs.values()):
            kind = {Param: "parameter", Input: "input"}.get(type(b))
            name = {"name": every[kind][b.name]} if kind else {}  # type: ignore[attr-defined]
            new[id(b)] = dc.replace(
                b, **name, **{s: new[id(getattr(b, s))] for s in signals(type(b))}
            )  # type: ignore[type-var]
        parts = [
            p.renamed(every["input"] | every["parameter"], every["output"]) for p in self.parts
        ]
        return Scene({every["output"][name]: new[id(b)] for name, b in self.outputs.items()}, parts)

    @staticmethod
    def combine(
        *unnamed: Any, share: Mapping[str, Sequence[str]] | None = None, **parts: Scene
    ) -> Scene:
        """Combine several scenes into one; each keeps its own signals and law.

        Parameters
        ----------
        **parts : Scene
            By the name that stands before the names of its inputs, parameters and
            outputs: ``wall=scene`` makes of ``x`` a ``wall_x``.
        share : dict of str to sequence of str, optional
            Inputs or parameters that are one, by their new name: ``{"x": ("wall_x",
            "bumps_x")}``.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            No part, or one without a name; what is shared differs in kind, unit or
            value; two parts mean different things by one name, or have noise of the
            same key.
        UnknownName
            Something is to be shared that no part has.

        Examples
        --------
        >>> from stimlib import Scene
        >>> from stimlib.scenes import bumps, wall
        >>> both = Scene.combine(
        ...     edge=wall(), screen=bumps(), share={"x": ("edge_x", "screen_x")}
        ... )
        >>> list(both.inputs), list(both.params), list(both.outputs)
        (['x'],
         ['edge_k', 'edge_b', 'screen_A', 'screen_duty', 'screen_freq'],
         ['edge_force', 'screen_voltage'])
        """
        if unnamed or not parts or not all(isinstance(s, Scene) for s in parts.values()):
            raise SceneError(
                "combine needs scenes by name, such as Scene.combine(edge=wall(), screen=bumps())"
            )
        one = _joined({} if share is None else share)
        outputs: dict[str, Block] = {}
        laws: list[Part] = []
        seen: dict[str, tuple[str, Any]] = {}
        for prefix, scene in parts.items():
            check_name("part", prefix, SceneError)
            new: dict[str, str] = {}
            controls: dict[str, Any] = {**scene.inputs, **scene.params}
            for name, b in controls.items():
                own = f"{prefix}_{name}"
                new[name] = one.pop(own, own)
                other, known = seen.setdefault(new[name], (f"{name} of {prefix}", b))
                same = repr(dc.replace(known, name="x")) == repr(dc.replace(b, name="x"))
                if not same or (known is not b and new[name] == own):
                    raise SceneError(
                        f"{new[name]!r} would be {other}, {known!r}, and {name} of {prefix}, {b!r},"
                        " which are not the same; give one another name"
                    )
            ends = {name: f"{prefix}_{name}" for name in scene.outputs}
            for name in ends.values():
                if name in outputs:
                    raise SceneError(
                        f"two parts would have the output {name!r}; give {prefix} another name"
                    )
            params = {name: new[name] for name in scene.params}
            inputs = {name: new[name] for name in scene.inputs}
            made = scene.renamed(params, inputs, ends)
            outputs |= made.outputs
            laws += [
                dc.replace(p, name=f"{prefix}_{p.name}" if p.name else prefix) for p in made.parts
            ]
        if one:
            raise UnknownName(
                f"share: no part has {next(iter(one))!r}; there are {', '.join(seen)}"
            )
        return Scene(outputs, laws)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        return self is other or self.hash == other.hash

    def __hash__(self) -> int:
        return hash(self.hash)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_lowered": None}  # its loops have classes that no module has

    def __repr__(self):
        names = [f"{n} [{b.dim}]" for n, b in (self.inputs | self.params).items()]
        return (
            f"Scene({', '.join(names) or 'no input'} ->"
            f" {', '.join(f'{n} [{b.dim}]' for n, b in self.outputs.items())})"
        )

    def _repr_html_(self) -> str:
        return above("Scene._repr_html_")(self)

    def live(self, fs: float = 8000.0, safety: Any = None, **options: Any) -> Any:
        """Show the scene live, in a notebook cell or at the ``.url`` of the result.

        A pointer drives it, and sliders set its parameters; plots and sound present its
        output. It runs beside the notebook until ``.close()``.  If the cell is run
        again, the scene takes the place of the one before, within a session too.

        Parameters
        ----------
        fs : float
            Hz.
        safety : Safety or float, optional
            As for a sink, the largest value, which is 1.0 in sound and recording; by
            default twice the peak of a trial.
        **options
            ``ranges``, ``given``, ``params``, ``seed``, ``folder``, ``title``,
            ``block`` and ``bandwidth`` as for ``stimlib.live.stream.Stream``; ``port``.

        Raises
        ------
        MissingPackage
            It needs ``pip install 'stimlib[live]'``.

        Examples
        --------
        See ``stimlib.live.notebook.show``.
        """
        return above("Scene.live")(self, fs, safety, **options)

    # File -----------------------------------------------------------------------------
    def to_dict(self) -> dict[str, Any]:
        """Return the scene as plain JSON data.

        Blocks have their registered names, children come before parents, arrays are
        lists.
        """
        order: Any = reach(self.outputs.values())
        number = {id(b): i for i, b in enumerate(order)}

        def value(v: Any) -> Any:
            if isinstance(v, Block):
                return number[id(v)]
            return v.tolist() if isinstance(v, np.ndarray) else v

        blocks = [
            {
                "class": type_name(type(b)),
                "fields": {f.name: value(getattr(b, f.name)) for f in dc.fields(b)},
            }
            for b in order
        ]
        outputs = {n: number[id(b)] for n, b in self.outputs.items()}
        parts: Any = [p.to_dict() for p in self.parts] or None
        # as version 1 has it, and its hash
        old = not parts or (len(parts) == 1 and parts[0]["given"] is None)
        law = self.parts[0].law if old and parts else parts
        return {
            "stimlib_scene": 1 if old else VERSION,
            "law": law,
            "blocks": blocks,
            "outputs": outputs,
        }

    @classmethod
    def from_dict(cls, data: Any, where: str = "scene") -> Scene:
        """Make a scene from ``to_dict`` data.

        Only registered block classes are made; no code runs.

        Raises
        ------
        SceneFileError
            Newer version, unknown class, missing or surplus field, reference to a later
            block.
        """
        if not isinstance(data, dict) or "stimlib_scene" not in data:
            raise SceneFileError(f"{where}: not a stimlib scene")
        version = data["stimlib_scene"]
        if version not in (1, VERSION) or isinstance(version, bool):
            raise SceneFileError(
                f"{where}: file version {version!r:.40}, this stimlib reads {VERSION}: update"
                " stimlib"
            )
        entries, outputs = data.get("blocks"), data.get("outputs")
        if not isinstance(entries, list) or not isinstance(outputs, dict):
            raise SceneFileError(f"{where}: needs a list of blocks and a table of outputs")
        limits.check("scene_blocks", len(entries), f"{where}: blocks", SceneFileError)
        _define({str(entry.get("class")) for entry in entries if isinstance(entry, dict)})
        made: list[Block] = []
        for entry in entries:
            made.append(_block_of(entry, made, where))
        law = data.get("law")
        if isinstance(law, list):
            law = [Part.from_dict(part, where) for part in law]
        elif isinstance(law, str):
            law = [Part(law)]  # which another version may know
        elif law is not None:
            raise SceneFileError(f"{where}: law must be a name, or a list of laws")
        ends = {n: _earlier(made, v, f"{where}: output {n!r}") for n, v in outputs.items()}
        return cls(ends, law)

    @property
    def hash(self) -> str:
        """sha256 of the canonical JSON: equal for equal scenes on every machine."""
        text = json.dumps(self.to_dict(), sort_keys=True, allow_nan=False, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def save(self, path: str | os.PathLike) -> None:
        """Write the scene as JSON, atomically.

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        SceneFileError
            The folder is missing or cannot be written.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> from stimlib import Input, Scene, load
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "scene.json"
        >>> Scene({"y": 2 * Input("x")}).save(path)
        >>> load(path)
        Scene(x [1] -> y [1])
        """
        safe_files.publish(
            path, json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n", SceneFileError
        )


@public
def load(path: str | os.PathLike) -> Scene:
    """Read a scene that ``Scene.save`` wrote.

    The file is data: nothing in it is executed.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    SceneFileError
        Missing, damaged or newer file; a block class that is not imported; more bytes
        or blocks than ``stimlib.limits.scene_bytes`` and ``scene_blocks``.

    Examples
    --------
    See ``Scene.save``.
    """
    text = safe_files.read(path, "scene_bytes", SceneFileError)
    # reading them would take long
    limits.check("scene_blocks", text.count(b'"class"'), f"{path}: blocks", SceneFileError)
    with said_as(SceneFileError, f"{path}: not JSON", ValueError):
        data = strict(text.decode())
    return Scene.from_dict(data, str(path))


def _joined(share: Mapping[str, Any]) -> dict[str, str]:
    """Return the new name of each input or parameter that is shared."""
    if not isinstance(share, Mapping):
        raise SceneError(
            f"share = {share!r:.80} must map new names to names, such as {{'x': ('edge_x',"
            " 'screen_x')}"
        )
    one: dict[str, str] = {}
    for joint, names in share.items():
        if isinstance(names, str) or not isinstance(names, Sequence):
            raise SceneError(
                f"share: {joint!r} is {names!r:.80}, not a tuple of names; give one such as"
                " ('edge_x', 'screen_x')"
            )
        for name in names:
            if one.setdefault(name, joint) != joint:
                raise SceneError(
                    f"share: {name!r} would be {one[name]!r} and {joint!r}; give it one name"
                )
    return one


def _define(names: set[str]) -> None:
    """Import the modules of ``blocks`` that define classes of these names.

    The texts are searched for them: to import all modules takes ten times as long.
    """
    blocks, new = above("blocks"), names - registry.keys()
    for path in sorted(Path(blocks.__file__).parent.glob("*.py")) if new else ():
        if not new.isdisjoint(re.findall(r"^class (\w+)", path.read_text("utf-8"), re.MULTILINE)):
            import_module(f"{blocks.__name__}.{path.stem}")


def _block_of(entry: Any, made: list[Block], where: str) -> Block:
    """Return the block that an entry of a file describes.

    It may refer only to blocks made before it.
    """
    where = f"{where}: block {len(made)}"
    name, given = (entry.get(k) for k in ("class", "fields")) if isinstance(entry, dict) else (0, 0)
    if not isinstance(name, str) or not isinstance(given, dict):
        raise SceneFileError(f"{where} must have a class and fields")
    if name not in registry:
        hint = _remedy(name.rpartition(".")[0]) if "." in name else "update stimlib"
        raise SceneFileError(f"{where} is a {name!r}, which is not known here: {hint}")
    kind, where = registry[name], f"{where} ({name})"
    known = {f.name for f in dc.fields(kind)}  # type: ignore[arg-type]
    if wrong := ", ".join(sorted(set(given) ^ known)):
        raise SceneFileError(f"{where}: fields {wrong} are missing or not known")
    inputs = {s: _earlier(made, given[s], f"{where}.{s}") for s in signals(kind)}
    try:
        return kind(**given | inputs)
    except StimlibError as e:
        raise SceneFileError(f"{where}: {e}") from e
    except (TypeError, ValueError, AttributeError) as e:
        raise SceneFileError(f"{where} has a field of a wrong kind: {e}") from e


def _earlier(made: list[Block], number: Any, what: str) -> Block:
    """Return the block with this number; raise SceneFileError unless it is earlier."""
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < len(made):
        raise SceneFileError(f"{what} refers to {number!r:.40}, which is not an earlier block")
    return made[number]


def _remedy(module: str) -> str:
    """Return advice on how to make the blocks of a module known."""
    if module == "__main__":
        return (
            "a script or a notebook defined it; define it in a file of its own, import that there,"
            " and record again"
        )
    file = f"{module}.py" if module.isidentifier() else f"a file of yours that imports {module}"
    return f"import {module} first; on the command line, add --import {file}"
