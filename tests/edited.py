"""Sweep before and after an edit of a user's source, as tests/test_sweep_edits.py asks.

python tests/edited.py PLACE FOLDER WORKERS < cases.json

A case is a name, a source, and the same source edited.  PLACE is where a user keeps the
source: a script, a module, a package, a module that is reloaded, or a notebook whose
cell runs again.  Each state of a script, module or package has a process of its own.
Prints a name and what became of the case as JSON, one line for each.
"""

import importlib
import json
import linecache
import os
import sys
import types
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from stimlib import BadValue, Input, Scene
from stimlib.sweep import sweep

PACKAGE = (
    "import lab.sub.source\nfrom .sub.source import figure, hand\ndef make(a): return"
    " lab.sub.source.make(a)\n"
)
ONE_PROCESS = "reloaded", "notebook"


def loaded(place, text):
    """Return the module in which this state of the source is, loaded from the current
    folder as a user's program does it.
    """
    match place:
        case "script":
            Path("study.py").write_text(text)
            sys.modules["__main__"] = module = types.ModuleType("__main__")
            module.__file__ = str(Path("study.py").resolve())
            exec(compile(text, module.__file__, "exec"), vars(module))
        case "notebook":
            module = sys.modules["__main__"]
            if hasattr(module, "__file__"):
                sys.modules["__main__"] = module = types.ModuleType("__main__")
            name = f"<cell {hash(text)}>"
            linecache.cache[name] = len(text), None, text.splitlines(keepends=True), name
            exec(compile(text, name, "exec"), vars(module))
        case "module" | "reloaded":
            Path("source.py").write_text(text)
            module = importlib.import_module("source")
            if place == "reloaded":
                importlib.reload(module)
        case "package":
            Path("lab/sub").mkdir(parents=True, exist_ok=True)
            for name, content in (
                ("__init__", ""),
                ("sub/__init__", ""),
                ("sub/source", text),
                ("study", PACKAGE),
            ):
                Path(f"lab/{name}.py").write_text(content)
            module = importlib.import_module("lab.study")
    return module


def swept(of, out=None, workers=0):
    """Return the table of what such a module has."""
    words = {"motion": of.hand, "measures": ["rms(y)", of.figure], "fs": 1000, "seconds": 0.1}
    return sweep(of.make, {"a": [1.0, 2.0]}, out=out, workers=workers, progress=False, **words)


def before(place, text, workers):
    """Sweep, and keep the figures."""
    try:
        swept(loaded(place, text), "out", workers)
    except BadValue as e:
        return f"refused before: {e}"
    return ""


def after(place, text, workers):
    """Sweep once more, and say what became of the figures that were kept."""
    parts = sorted(Path("out").iterdir())
    today = swept(loaded(place, text), None, workers)
    try:
        kept = swept(loaded(place, text), "out", workers)
    except BadValue as e:
        return f"refused: {e}"
    if not kept.equals(today):
        return "stale"
    return "kept" if sorted(Path("out").iterdir()) == parts else "run again"


def both(place, old, new, workers):
    """Sweep before and after the edit in one process."""
    return before(place, old, workers) or after(place, new, workers)


def in_a_process(f, *args):
    """Return what a function returns in a fork of this process."""
    with ProcessPoolExecutor(1, get_context("fork")) as forks:
        return forks.submit(f, *args).result()


def main(place, folder, workers):
    """Do all cases, each in a folder of its own."""
    sys.dont_write_bytecode = True  # its time has whole seconds
    words = {"motion": [0.0], "measures": "rms", "fs": 1000, "workers": 0, "progress": False}
    sweep(Scene({"y": 1.0 * Input("x")}), {"seed": [0]}, **words)  # loads all once, before forks
    sys.path.insert(0, "")
    for at, (name, old, new) in enumerate(json.load(sys.stdin)):
        os.makedirs(os.path.join(folder, str(at)))
        os.chdir(os.path.join(folder, str(at)))
        said = (
            in_a_process(both, place, old, new, workers)
            if place in ONE_PROCESS
            else in_a_process(before, place, old, workers)
            or in_a_process(after, place, new, workers)
        )
        print(json.dumps([name, said]), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], os.path.abspath(sys.argv[2]), int(sys.argv[3]))
