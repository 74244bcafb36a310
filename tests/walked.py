"""Functions as compiled code runs them: walked, compiled and called with arrays."""

import ctypes
import subprocess
from types import FunctionType

import numpy as np

from stimlib.export.program import OF_DOUBLES, RUNTIME
from stimlib.export.translate import Unit
from stimlib.export.values import C_TYPES
from stimlib.targets.llvm import known, machine, walk

KINDS = {np.dtype("f8"): "f8", np.dtype("u8"): "u8", np.dtype("i8"): "i8", np.dtype("b1"): "b1"}
CTYPES = {"f8": ctypes.c_double, "u8": ctypes.c_uint64, "i8": ctypes.c_int64, "void": None}
CTYPES["b1"] = ctypes.c_bool


def compiled(f: FunctionType, result: str = "void"):
    """A function of arrays, numbers, functions and tuples of them, compiled for each
    form of its arguments; it returns a number of a kind, such as "f8", or nothing.
    """
    made = {}

    def run(*given):
        parts, objects = [], {"f": f, "array": known.array}
        words = ", ".join(_form(x, parts, objects) for x in given)
        kinds = [kind for kind, _ in parts]
        key = words, *kinds
        if key not in made:
            made[key] = _made(words, kinds, result, objects), objects
        numbers = [x.ctypes.data if kind[-1] == "*" else x.item() for kind, x in parts]
        return made[key][0](*numbers)

    return run


def _form(x, parts, objects) -> str:
    """How a source names an argument; its parts, and what it is made of, are noted."""
    if isinstance(x, FunctionType | type):
        objects[name := f"{x.__name__}_{id(x)}"] = x
        return name
    if isinstance(x, tuple):
        of = _form(type(x), parts, objects) if hasattr(x, "_fields") else ""
        return f"{of}({''.join(f'{_form(v, parts, objects)}, ' for v in x)})"
    x = np.asarray(x)
    kind, v = KINDS[x.dtype], f"v{len(parts)}"
    if x.ndim == 0:
        parts.append((kind, x))
        return v
    assert x.flags.c_contiguous
    parts += [(f"{kind}*", x), ("i8", np.asarray(x.size))]
    return f"array({v}, v{len(parts) - 1})"


def _made(words, kinds, result, objects):
    names = ", ".join(f"v{k}" for k in range(len(kinds)))
    source = f"def run({names}):\n    return f({words})\n"
    text = walk.of_source(source, {**objects}, {"run": (result, *kinds)}, known.TWINS).llvm
    code, calls = machine.machine_code(text, ours=True)
    assert machine.missing(calls) == []
    pointers = [ctypes.c_void_p if kind[-1] == "*" else CTYPES[kind] for kind in kinds]
    return ctypes.CFUNCTYPE(CTYPES[result], *pointers)(machine.addresses(code, ["run"])["run"])


def in_c(f: FunctionType, kinds: list[str], folder):
    """The same of a function of numbers and arrays, as an export has it in C; what it
    does must be defined in C.
    """
    unit, given, passed = Unit(), [], []
    name, _ = unit.function(f, kinds)
    for k, kind in enumerate(kinds):
        array = kind[-1] == "*"
        given.append(f"{C_TYPES[kind[:2]]} {'*' * array}v{k}" + f", int64_t n{k}" * array)
        passed.append(f"{C_TYPES[kind]}_of(v{k}, n{k})" if array else f"v{k}")
    run = f"void run({', '.join(given)}) {{ {name}({', '.join(passed)}); }}"
    texts = [*unit.maths.types, *unit.maths.functions, *unit.types, *unit.functions, run]
    runtime = RUNTIME.read_text().replace(OF_DOUBLES, "")
    (folder / "f.c").write_text("\n".join([runtime, *texts]))
    checks = "-fsanitize=undefined -fsanitize-undefined-trap-on-error"
    words = f"gcc -std=c99 -O1 {checks} -shared -fPIC f.c -o f.so -lm"
    subprocess.run(words.split(), cwd=folder, check=True)
    made = ctypes.CDLL(folder / "f.so").run

    def call(*given):
        numbers = []
        for kind, x in zip(kinds, given, strict=True):
            if kind[-1] == "*":
                numbers += [ctypes.c_void_p(x.ctypes.data), ctypes.c_int64(x.size)]
            else:
                numbers.append(CTYPES[kind](np.asarray(x).item()))
        made(*numbers)

    return call
