"""A scene: named outputs, and the file it is kept in."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import importlib
import json
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import SceneError, SceneFileError, StimlibError, UnknownName, public
from . import regular
from .bounds import limits
from .graph import Block, Input, Param, as_block, check_name, reach, registry, signals, type_name
from .program import Program, lower

VERSION = 1


@public
class Scene:
    """Named outputs of a graph: what a researcher writes, saves, compiles and shares.

    Parameters
    ----------
    outputs : dict of str to Block
    law : str, optional
        Name of the physical law (``stimlib.checks.scenes.SCENES``) that a verifier shall hold the outputs against.

    Raises
    ------
    SceneError
        No outputs; names used twice with different meaning; noise keys that collide.

    Examples
    --------
    >>> from stimlib import Input, Param, Scene
    >>> Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")})
    Scene(x [m], k [N/m] -> force [N])
    """

    def __init__(self, outputs: Mapping[str, Block], law: str | None = None):
        if not isinstance(outputs, Mapping) or not outputs:
            raise SceneError('a scene needs named outputs, such as Scene({"force": force})')
        for name in outputs:
            check_name("output", name, SceneError)
        self.law = law
        self.outputs: dict[str, Block] = {name: as_block(b) for name, b in outputs.items()}
        self._lowered: tuple[list[tuple[str, int]], Program] | None = None
        _ = self.program  # finds what is wrong with the graph now, where it was written

    @property
    def program(self) -> Program:
        """What ``lower`` makes of the outputs, made once."""
        known = [(name, id(b)) for name, b in self.outputs.items()]
        if self._lowered is None or self._lowered[0] != known:
            self._lowered = known, lower(self.outputs)
        return self._lowered[1]

    @property
    def inputs(self) -> dict[str, Input]:
        """By name, in the order of first use."""
        return {b.name: b for b in reach(self.outputs.values()) if isinstance(b, Input)}

    @property
    def params(self) -> dict[str, Param]:
        """Parameters by name."""
        return {b.name: b for b in reach(self.outputs.values()) if isinstance(b, Param)}

    def renamed(self, names: Mapping[str, str]) -> Scene:
        """Return the same scene with other names of some parameters, so that two stimuli of one kind fit into one scene.

        Parameters
        ----------
        names : dict of str to str
            New names by the old ones.

        Returns
        -------
        Scene
            Without a law, as laws know parameters by their names.

        Raises
        ------
        UnknownName
            The scene has no such parameter.
        BadValue
            No name that a parameter can have.

        Examples
        --------
        >>> from stimlib import Input, Param, Scene
        >>> Scene({"force": Param("k", 2000.0, "N/m") * Input("x", "m")}).renamed({"k": "k_2"})
        Scene(x [m], k_2 [N/m] -> force [N])
        """
        if unknown := [name for name in names if name not in self.params]:
            raise UnknownName(f"no parameter {unknown[0]!r}; this scene has {', '.join(self.params) or 'none'}")
        new: dict[int, Block] = {}
        for b in reach(self.outputs.values()):
            name = {"name": names.get(b.name, b.name)} if isinstance(b, Param) else {}
            new[id(b)] = dc.replace(b, **name, **{s: new[id(getattr(b, s))] for s in signals(type(b))})  # type: ignore[type-var]
        return Scene({name: new[id(b)] for name, b in self.outputs.items()})

    def __repr__(self):
        names = [f"{n} [{b.dim}]" for n, b in (self.inputs | self.params).items()]
        return f"Scene({', '.join(names) or 'no input'} -> {', '.join(f'{n} [{b.dim}]' for n, b in self.outputs.items())})"

    def _repr_html_(self) -> str:
        return importlib.import_module("stimlib.analysis.draw").html_of(self)

    def live(self, fs: float = 8000.0, safety: Any = None, **options: Any) -> Any:
        """Show the scene live: in a notebook as a page in the cell, elsewhere at ``.url`` of what is returned.

        A pointer drives it, sliders set its parameters; plots and sound show what comes.  It runs beside the notebook until
        ``.close()``, or until the same scene is shown again.

        Parameters
        ----------
        fs : float
            Hz.
        safety : Safety or float, optional
            As for a sink: the value that is 1.0 in sound and recording; by default twice the peak of a trial.
        **options
            ``ranges``, ``given``, ``params``, ``seed``, ``folder``, ``title``, ``block`` and ``bandwidth`` as for
            ``stimlib.live.stream.Stream``; ``port``.

        Raises
        ------
        MissingPackage
            It needs ``pip install 'stimlib[live]'``.

        Examples
        --------
        See ``stimlib.live.notebook.show``.
        """
        return importlib.import_module("stimlib.live.notebook").show(self, fs, safety, **options)

    # File --------------------------------------------------------------------------------------------------------
    def to_dict(self) -> dict[str, Any]:
        """The scene as plain JSON data: blocks by registered name, children before parents, arrays as lists."""
        order = reach(self.outputs.values())
        number = {id(b): i for i, b in enumerate(order)}
        blocks = []
        for b in order:
            fields: dict[str, Any] = {}
            for f in dc.fields(b):  # type: ignore[arg-type]
                v = getattr(b, f.name)
                if isinstance(v, Block):
                    fields[f.name] = number[id(v)]
                else:
                    fields[f.name] = v.tolist() if isinstance(v, np.ndarray) else v
            blocks.append({"class": type_name(type(b)), "fields": fields})
        outputs = {n: number[id(b)] for n, b in self.outputs.items()}
        return {"stimlib_scene": VERSION, "law": self.law, "blocks": blocks, "outputs": outputs}

    @classmethod
    def from_dict(cls, data: Any, where: str = "scene") -> Scene:
        """A scene from ``to_dict`` data.  Only registered block classes are made; no code runs.

        Raises
        ------
        SceneFileError
            Newer version, unknown class, missing or surplus field, reference to a later block.
        """
        if not isinstance(data, dict) or "stimlib_scene" not in data:
            raise SceneFileError(f"{where}: not a stimlib scene")
        version = data["stimlib_scene"]
        if version != VERSION:
            raise SceneFileError(f"{where}: file version {version!r:.40}, this stimlib reads {VERSION}: update stimlib")
        importlib.import_module("stimlib.blocks")  # registers ours

        made: list[Block] = []

        def ref(v: Any, what: str) -> Block:
            if not isinstance(v, int) or isinstance(v, bool) or not 0 <= v < len(made):
                raise SceneFileError(f"{where}: {what} refers to {v!r:.40}, which is not an earlier block")
            return made[v]

        entries, outputs = data.get("blocks"), data.get("outputs")
        if not isinstance(entries, list) or not isinstance(outputs, dict):
            raise SceneFileError(f"{where}: needs a list of blocks and a table of outputs")
        limits.check("scene_blocks", len(entries), f"{where}: blocks", SceneFileError)
        for i, entry in enumerate(entries):
            if (
                not isinstance(entry, dict)
                or not isinstance(entry.get("class"), str)
                or not isinstance(entry.get("fields"), dict)
            ):
                raise SceneFileError(f"{where}: block {i} must have a class and fields")
            name = entry["class"]
            if name not in registry:
                hint = _remedy(name.rpartition(".")[0]) if "." in name else "update stimlib"
                raise SceneFileError(f"{where}: block {i} is a {name!r}, which is not known here: {hint}")
            kind = registry[name]
            fields = dict(entry["fields"])
            known = {f.name for f in dc.fields(kind)}  # type: ignore[arg-type]
            if set(fields) != known:
                wrong = ", ".join(sorted(set(fields) ^ known))
                raise SceneFileError(f"{where}: block {i} ({name}): fields {wrong} are missing or not known")
            for s in signals(kind):
                fields[s] = ref(fields[s], f"block {i} ({name}).{s}")
            try:
                made.append(kind(**fields))
            except StimlibError as e:
                raise SceneFileError(f"{where}: block {i} ({name}): {e}") from e
            except (TypeError, ValueError, AttributeError) as e:
                raise SceneFileError(f"{where}: block {i} ({name}) has a field of a wrong kind: {e}") from e
        law = data.get("law")
        if not isinstance(law, (str, type(None))):
            raise SceneFileError(f"{where}: law must be a name")
        return cls({n: ref(v, f"output {n!r}") for n, v in outputs.items()}, law)

    @property
    def hash(self) -> str:
        """sha256 of the canonical JSON: equal for equal scenes on every machine."""
        text = json.dumps(self.to_dict(), sort_keys=True, allow_nan=False, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def save(self, path: str | os.PathLike) -> None:
        """Write the scene as JSON; the file appears whole or not at all.

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
        regular.publish(path, json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n", SceneFileError)


@public
def load(path: str | os.PathLike) -> Scene:
    """Read a scene that ``Scene.save`` wrote.  The file is data: nothing in it is executed.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    SceneFileError
        Missing, damaged or newer file; a block class that is not imported; more bytes or blocks than
        ``stimlib.limits.scene_bytes`` and ``scene_blocks``.

    Examples
    --------
    See ``Scene.save``.
    """
    text = regular.read(path, "scene_bytes", SceneFileError)
    limits.check("scene_blocks", text.count(b'"class"'), f"{path}: blocks", SceneFileError)  # reading them would take long
    try:
        data = json.loads(text.decode(), parse_constant=_no_constant)
    except (ValueError, RecursionError) as e:
        raise SceneFileError(f"{path}: not JSON ({e})") from e
    return Scene.from_dict(data, str(path))


def _remedy(module: str) -> str:
    """What makes the blocks of a module known."""
    if module == "__main__":
        return "a script or a notebook defined it; define it in a file of its own, import that there, and record again"
    file = f"{module}.py" if module.isidentifier() else f"a file of yours that imports {module}"
    return f"import {module} first; on the command line, add --import {file}"


def _no_constant(text: str) -> Any:
    raise ValueError(f"{text} is not a finite number")
