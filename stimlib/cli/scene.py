"""SCENE on the command line: a shipped scene, a user's function, or a saved scene."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import BadValue, SceneError, StimlibError, UnknownName, need
from ..system import safe_files

if TYPE_CHECKING:  # --help and --version need no numpy
    from ..core.scene import Scene


def shipped() -> Mapping[str, Callable[..., Scene]]:
    """Return the shipped scenes by name."""
    from ..scenes import SHIPPED

    return SHIPPED


def _begun(text: str) -> list[str]:
    """Return the shipped scenes whose names begin with a text, for shell completion."""
    return [name for name in shipped() if name.startswith(text)]


SceneText = Annotated[
    str,
    typer.Argument(
        autocompletion=_begun,
        metavar="SCENE",
        help=(
            "A shipped scene ([bold]stimlib list[/]), optionally with arguments: "
            "[bold]'squeeze(fingers=1)'[/]; [bold]path.py:name[/], a scene or a function in "
            "your own file (the file is run); or [bold]path.json[/], a saved scene (data; "
            "nothing in it is run)."
        ),
        show_default=False,
    ),
]


def scene_of(text: str, files: Sequence[str] = ()) -> Scene:
    """Return the scene that SCENE on the command line stands for.

    The --import files are run first: they may define blocks of it.

    Raises
    ------
    UnknownName, SceneError
        There is nothing of that name, or the function does not return a scene.

    Examples
    --------
    >>> from stimlib.cli.scene import scene_of
    >>> list(scene_of("squeeze").outputs)
    ['force1', 'force2']
    """
    run_files(files)
    name, _, words = text.partition("(")
    if name in shipped():
        return _shipped(name, f"({words}" if words else "()")
    path, _, function = text.rpartition(":")
    if path.endswith(".py"):
        return _own(path, function)
    if text.endswith(".py"):
        return _own(text, "")
    if text.endswith(".json"):
        from ..core.scene import load

        return load(text)
    near = get_close_matches(name, shipped(), 1)
    meant = f"did you mean {near[0]}? U" if near else "u"
    raise UnknownName(
        f"no scene {text!r}: {meant}se one of {', '.join(shipped())}, path.py:name or path.json"
    )


def maker_of(text: str) -> Scene | Callable[..., Scene]:
    """Return the scene for a sweep, or the function that makes it.

    A function is not called, because the rows of the sweep may hold its arguments.

    Raises
    ------
    UnknownName, SceneError
        As `scene_of`.

    Examples
    --------
    >>> from stimlib.cli.scene import maker_of
    >>> maker_of("squeeze").__name__, maker_of("squeeze(fingers=1)")
    ('squeeze', Scene(x1 [m], k [N/m], A [1], level [1] -> force1 [N]))
    """
    if text in shipped():
        return shipped()[text]
    path, _, name = text.rpartition(":")
    return own_of(path, name) if path.endswith(".py") else scene_of(text)


def own_of(path: str, name: str, *, kind: type | None = None) -> Any:
    """Return a scene, function or measure from a user's file, without calling it.

    The file is executed, and worker processes can then import it.

    An object of the wanted kind may be named as well as a function.
    """
    return _own(path, name, called=False, kind=kind)


def beside(paths: Sequence[str]) -> dict[str, str]:
    """Return the modules from the folders of users' files, and their files."""
    # names alone: to resolve each of a thousand modules takes 30 ms, at every look
    folders = {str(f) for p in paths for f in (Path(p).absolute().parent, Path(p).resolve().parent)}
    files = {n: getattr(m, "__file__", None) for n, m in [*sys.modules.items()]}
    of_users = {n: f for n, f in files.items() if f and n.partition(".")[0] != "stimlib"}
    return {n: f for n, f in of_users.items() if os.path.dirname(os.path.abspath(f)) in folders}


def forget(paths: Sequence[str]) -> None:
    """Let users' files, and the modules beside them, run again when they are used."""
    for name, file in beside(paths).items():
        if name != "__main__":
            del sys.modules[name]
            _ours.pop(name, None)
            # of a file edited within a second to equal length, Python keeps the code
            with suppress(OSError, NotImplementedError):
                Path(importlib.util.cache_from_source(file)).unlink(missing_ok=True)
    importlib.invalidate_caches()


_ours: dict[str, bytes] = {}  # modules that _own has made, and the text that each has run


def _own(
    path: str, function: str | None = None, called: bool = True, kind: type | None = None
) -> Any:
    """Run a user's file as a module, under the name that scene files refer to.

    Return the module, or the result of a function in it. A file that has run is not run
    again. If the file or the function raises an error, the error names the line.
    """
    from ..core.graph import files
    from ..core.scene import Scene

    module, spec, text = _module(path)
    if called:
        files.add(spec.origin)
    name = spec.name
    folder = str(Path(path).resolve().parent)
    if folder not in sys.path:  # behind all else: a file may import what lies beside it
        sys.path.append(folder)
    try:
        if not _ours[name]:
            # The text that was read: a loader runs what it compiled before, if a file
            # was changed within a second to a text of equal length.
            exec(compile(text, spec.origin, "exec", dont_inherit=True), vars(module))
            _ours[name] = text
        if function is None:
            return None
        found: Any = getattr(module, function, None)
        kind = kind or Scene
        if not (callable(found) or isinstance(found, (Scene, kind))):
            raise SceneError(_missing(path, module, function, kind))
        if not called:
            return found
        scene = found if isinstance(found, Scene) else found()
    except Exception as e:
        told = _told(e, path, spec.origin, function)
        if told is e:
            raise
        raise told from e
    if not isinstance(scene, Scene):
        raise SceneError(f"{path}:{function} returns {type(scene).__name__}, not a Scene")
    return scene


def _module(path: str) -> tuple[ModuleType, Any, bytes]:
    """Return a user's file as a module that has not yet run, with its spec and text."""
    text = safe_files.read(path, "scene_bytes", SceneError)  # a regular file
    name = Path(path).stem
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise SceneError(f"{path} is not a Python file: name one such as click_block.py")
    if name in (sys.modules.keys() | sys.stdlib_module_names) - _ours.keys():
        raise SceneError(
            f"{path}: there is another module {name}, which stimlib may need: give the file another"
            " name"
        )
    if _ours.get(name) != text or sys.modules[name].__file__ != spec.origin:
        sys.modules[name] = importlib.util.module_from_spec(spec)
        _ours[name] = b""
    return sys.modules[name], spec, text


def _missing(path: str, module: ModuleType, function: str, kind: type) -> str:
    """Return the error for a file without the wanted function, naming those it has."""
    of = kind.__name__.lower()
    if function in vars(module):
        what = f"{function} is a {type(vars(module)[function]).__name__}, no {kind.__name__}"
    elif function:
        what = f"there is no {function!r} in it"
    else:
        what = f"say which function or {of} in it"
    makes = [n for n, v in vars(module).items() if isinstance(v, kind) or _makes(module, v)]
    there = ", ".join(makes) or f"no function without arguments, and no {of}"
    return f"{path}: {what}: write {path}:NAME; it defines {there}"


def _told(e: Exception, path: str, origin: str | None, function: str | None) -> Exception:
    """Return an error prefixed with the line of the user's file that raised it."""
    frames = traceback.extract_tb(e.__traceback__)
    at = [frame.lineno for frame in frames if frame.filename == origin]
    line = at[-1] if at else e.lineno if isinstance(e, SyntaxError) else None
    if line is None and isinstance(e, StimlibError):
        return e
    what = str(e) if isinstance(e, StimlibError) else f"{type(e).__name__}: {e}"
    return SceneError(f"{path}:{line or function or 1}: {what}")


def _makes(module: ModuleType, found: Any) -> bool:
    """Return whether a user's function can make a scene without arguments."""
    if not inspect.isfunction(found) or found.__module__ != module.__name__:
        return False
    try:
        inspect.signature(found).bind()
    except TypeError:
        return False
    return not found.__name__.startswith("_")


def run_files(files: Sequence[str]) -> None:
    """Run the --import files, so that their blocks are known."""
    for path in files:
        _own(path)


def _shipped(name: str, words: str) -> Scene:
    """Call a shipped scene with literal keyword arguments."""
    make = shipped()[name]
    chosen: dict[Any, Any] = {None: 0}
    # as deep as the parser goes
    with suppress(SyntaxError, ValueError, TypeError, RecursionError, MemoryError):
        call = ast.parse(name + words, mode="eval").body
        if isinstance(call, ast.Call) and not call.args:
            chosen = {k.arg: ast.literal_eval(k.value) for k in call.keywords}
    if None in chosen:
        raise BadValue(f"scene {name}{words}: write {name}(name=number, ..)")
    need(name, chosen, inspect.signature(make).parameters, "argument")
    return make(**chosen)


def touching(text: str) -> str:
    """Return a hint on how to get the input ``contact`` for SCENE."""
    name = text.partition("(")[0]
    return f"use {name}(contact=True)" if name in shipped() else ""


def params_of(items: list[str], scene: Scene) -> dict[str, float]:
    """Return the --set values as numbers; a level may be ``2 m/s^2 rms``."""
    from ..design.levels import amplitude
    from ..motion.text import pairs

    values = {}
    units = {name: param.unit for name, param in scene.params.items()}
    for name, text in pairs(items, "--set", "NAME=VALUE").items():
        values[name] = (
            amplitude(text, units[name])
            if name in units and len(text.split()) > 1
            else number(text, f"--set {name}={text}")
        )
    need("--set", values, units, "parameter")
    return values


def number(text: str, option: str) -> float:
    """Return the number that an option gives; raise BadValue that names the option."""
    try:
        return float(text)
    except ValueError:
        raise BadValue(f"{option}: {text!r} is not a number") from None
