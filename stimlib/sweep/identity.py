"""Hashes of the code and data behind a user's function, as they are in memory."""

from __future__ import annotations

import builtins
import dis
import functools
import gc
import hashlib
import importlib
import importlib.metadata
import importlib.util
import math
import sys
import sysconfig
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from copyreg import dispatch_table
from pathlib import Path
from typing import Any

import numpy as np

from ..core.graph import Block, Pick, reach
from ..core.scene import Scene
from ..errors import BadValue
from ..motion.generators import Motion as Generated
from ..motion.recorded import Recording
from .measures import Measure

INSTALLED = [Path(sysconfig.get_path("stdlib")).resolve(), Path(__file__).resolve().parents[1]]
"""Folders of modules that are identified by their name and version."""
ATOMS = (
    type(None),
    bool,
    int,
    float,
    complex,
    str,
    bytes,
    range,
    type(Ellipsis),
    type(NotImplemented),
)
# what they consist of
HELD: dict[type, Callable[[Any], Any]] = {
    list: list,
    tuple: list,
    types.MethodType: lambda m: [m.__self__, m.__func__],
    staticmethod: lambda m: [m.__func__],
    classmethod: lambda m: [m.__func__],
    property: lambda p: [p.fget, p.fset, p.fdel],
    functools.cached_property: lambda p: [p.func],
}
DESCRIPTORS = (
    types.MethodDescriptorType,
    types.WrapperDescriptorType,
    types.ClassMethodDescriptorType,
    types.GetSetDescriptorType,
    types.MemberDescriptorType,
)
NOT_RUN = {
    "__dict__",
    "__weakref__",
    "__doc__",
    "__module__",
    "__annotations__",
    "__qualname__",
    "_abc_impl",
    "__slotnames__",  # which copying and pickling add
}
"""Attributes of a class that do not affect computations."""
BY_NAME = {"eval", "exec", "globals", "__import__", "import_module", "modules", "resolve_name"}
BY_NAME |= {"_getframe", "currentframe", "getmodule"}
"""What finds code by a name that is computed."""
READS = ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_DEREF", "LOAD_CLOSURE", "LOAD_CLASSDEREF")
"""Instructions that read a variable: the first two a global one."""
LISTS = {"__globals__", "f_globals", "__subclasses__", "__annotations__"}
"""Attributes through which code can find objects that it does not name."""


def identity(what: Any, called: str) -> str:
    """Return a hash that changes whenever the results of a function change.

    The hash covers the bytecode as Python loaded it, and everything that the code uses:
    global variables, imported modules, defaults, closures, attributes, classes with
    their bases and methods.  A function or class of an installed package enters by its
    name and version.

    Parameters
    ----------
    what : object
        A measure, function, class, or data.
    called : str
        Its name in an error message.

    Returns
    -------
    str
        Hexadecimal, 32 digits.

    Raises
    ------
    BadValue
        The code uses something whose content cannot be inspected, such as an open file.

    Examples
    --------
    >>> from stimlib.sweep.identity import identity
    >>> identity(lambda t: 2.0 * t, "motion") == identity(lambda t: 3.0 * t, "motion")
    False
    """
    try:
        return _Walk().of(what, called)
    except RecursionError:
        raise _hidden(called, what) from None


def own_classes(scene: Scene) -> list[type[Block]]:
    """Return the classes of a scene's user-defined blocks, in order of first use.

    These are the block classes that are not part of stimlib.
    """
    kinds = dict.fromkeys(type(b) for b in reach(scene.outputs.values()))
    return [k for k in kinds if _is_own(k.__module__)]


def _hidden(path: str, what: Any) -> BadValue:
    kind = f"{type(what).__module__}.{type(what).__qualname__}".removeprefix("builtins.")
    return BadValue(
        f"{path} is a {kind}, whose content cannot be seen, so a change of it could not be noticed;"
        " make it a column of the rows, a dataclass or an array, or state @measure(..,"
        ' version="1") and a new version with each change'
    )


class _Walk:
    """A traversal of a function and everything it uses, visiting each object once."""

    def __init__(self) -> None:
        # the object is kept, so that its id stays its own
        self._known: dict[int, tuple[Any, str]] = {}
        self._open: list[int] = []
        # in self._open, of what was met again inside of the object that is walked
        self._lowest = math.inf
        self._cyclic = 0

    def of(self, what: Any, path: str) -> str:
        """Return the hash of an object, which errors call ``path``."""
        if type(what) in ATOMS:
            return _hash(type(what).__name__, repr(what))
        if isinstance(what, np.generic) and type(what).__module__ == "numpy":
            return _hash(repr(what.dtype), repr(what))
        if id(what) in self._known:
            return self._known[id(what)][1]
        depth = len(self._open)
        if id(what) in self._open:  # a cycle
            at = self._open.index(id(what))
            self._lowest = min(self._lowest, at)
            return _hash("up", str(depth - at))
        outside, self._lowest = self._lowest, math.inf
        self._open.append(id(what))
        try:
            found = _hash(type(what).__name__, *self._parts(what, path))
        finally:
            self._open.pop()
        again = found
        if self._lowest < depth:  # seen from elsewhere, "up" would be another object
            self._cyclic += 1
            again = _hash("again", str(self._cyclic))
        self._known[id(what)] = what, again
        self._lowest = min(self._lowest, outside)
        return found

    def _all(self, values: Any, path: str) -> list[str]:
        return [self.of(v, path) for v in values]

    def _items(self, values: Any, path: str) -> list[str]:
        """Return the hashes of the names and values of a mapping."""
        parts = []
        for name, value in values.items():
            below = f"{path}.{name:.40}" if isinstance(name, str) else path
            parts += [self.of(name, path), self.of(value, below)]
        return parts

    def _parts(self, what: Any, path: str) -> list[str]:
        kind = type(what)
        if kind in HELD:
            return self._all(HELD[kind](what), path)
        if kind in DESCRIPTORS:
            return [what.__name__]
        kinds: dict[type, Callable[[Any, str], list[str]]] = {
            dict: self._items,
            types.MappingProxyType: self._items,
            set: self._set,
            frozenset: self._set,
            types.CodeType: self._code,
            types.FunctionType: self._function,
            types.ModuleType: self._module,
            types.BuiltinFunctionType: self._compiled,
            types.MethodWrapperType: self._compiled,
            np.ufunc: self._compiled,
        }
        if kind in kinds:
            return kinds[kind](what, path)
        if isinstance(what, type):
            return self._class(what, path)
        return self._ours(what, path) or self._instance(what, path)

    def _ours(self, what: Any, path: str) -> list[str]:
        """Return the hash parts of data of stimlib or numpy, or nothing."""
        kind = type(what)
        if kind is Measure and what.version is not None:
            return [what.name, repr(dict(what.units)), what.version]
        if isinstance(what, Scene):
            own = [kind] if _is_own(kind.__module__) else []
            return [what.hash, *self._all([*own, *own_classes(what)], path)]
        if isinstance(what, Block):
            shown = Pick(what, what.outputs[0]) if what.outputs else what
            return [self.of(Scene({"y": shown}), path)]
        if isinstance(what, Generated | Recording) and not _is_own(kind.__module__):
            return [repr(what)]  # which makes it again; a recording states the sha256 of its file
        if kind is np.ndarray and not what.dtype.hasobject:
            data = hashlib.sha256(np.ascontiguousarray(what).tobytes()).hexdigest()
            return [repr(what.dtype), str(what.shape), data]
        if what is np.random.mtrand._rand:  # whose state is another one in each process
            return [_version("numpy")]
        return []

    def _set(self, values: Any, path: str) -> list[str]:
        return sorted(self._all(values, path))

    # Code -----------------------------------------------------------------------------
    def _code(self, code: types.CodeType, path: str) -> list[str]:
        if found := LISTS & {*code.co_names}:
            raise _by_name(path, min(found))
        arguments = code.co_argcount + code.co_kwonlyargcount
        names = code.co_varnames if "locals" in code.co_names else code.co_varnames[:arguments]
        numbers = [code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags]
        text = [code.co_code, code.co_exceptiontable, code.co_names, names, numbers]
        return [repr(text), *self._all(code.co_consts, path)]

    def _function(self, f: types.FunctionType, path: str) -> list[str]:
        if _is_named(f):
            if f.__name__ in BY_NAME:
                raise _by_name(path, f.__name__)
            return [_name(f)]
        code = f.__code__
        if f.__doc__ is not None and code.co_consts[:1] == (f.__doc__,):
            code = code.replace(co_consts=(None, *code.co_consts[1:]))  # the docstring is not run
        parts = [f.__qualname__, *self._code(code, path)]
        parts += self._all([f.__defaults__, f.__kwdefaults__, f.__dict__], path)
        for name, cell in zip(code.co_freevars, f.__closure__ or (), strict=True):
            try:
                value = cell.cell_contents
            except ValueError:  # not filled yet
                value = None
            parts += self._named(name, value, f.__code__, f"{path}: {name}")
        for name in sorted(_loaded(f.__code__)):
            if name in f.__globals__:
                parts += self._named(name, f.__globals__[name], f.__code__, f"{path}: {name}")
            elif name in BY_NAME:
                raise _by_name(path, name)
            elif hasattr(builtins, name):
                parts += [name, self.of(getattr(builtins, name), path)]
        for name, module, wanted in _imports(f):
            parts.append(name)
            if not wanted and _is_own(module.__name__):
                parts.append(self.of(module, path))
            else:
                parts += self._attributes(module, wanted or _words(f.__code__), path)
        return parts

    def _named(self, name: str, value: Any, code: types.CodeType, path: str) -> list[str]:
        """Return the hash parts of the object that code calls by a name."""
        if isinstance(value, types.ModuleType):
            whole = [self.of(m, path) for m in _whole(code, name, value)]
            return [name, *whole, *self._attributes(value, _words(code), path)]
        package = type(value).__module__
        if not _is_own(package) and getattr(sys.modules.get(package), name, None) is value:
            # an object that a package made, such as scipy.stats.norm
            return [name, _version(package)]
        return [name, self.of(value, path)]

    # Modules and classes --------------------------------------------------------------
    def _attributes(self, module: types.ModuleType, names: set[str], path: str) -> list[str]:
        """Return the hash parts of those attributes of a module that code uses."""
        own = _is_own(module.__name__)
        if wrong := BY_NAME & names & vars(module).keys():
            raise BadValue(
                f"{path}.{min(wrong)} finds code by a name, so what is computed cannot be seen;"
                ' import it at the top, or state @measure(.., version="1")'
            )
        names = names | {"__getattr__"}
        parts = [module.__name__, "" if own else _version(module.__name__)]
        if type(module) is not types.ModuleType:  # it may have properties
            parts.append(self.of(type(module), path))
        for name in sorted(names & vars(module).keys()):
            value = vars(module)[name]
            if isinstance(value, types.ModuleType):
                key = id(value), frozenset(names)
                if hash(key) in self._open:
                    continue
                self._open.append(hash(key))
                parts += [name, *self._attributes(value, names, f"{path}.{name}")]
                self._open.pop()
            elif (
                own
                or type(value) in ATOMS
                or _is_own(getattr(value, "__module__", None) or "builtins")
            ):
                parts += [name, self.of(value, f"{path}.{name}")]
            else:
                parts += [name, getattr(value, "__name__", "")]
        return parts

    def _module(self, module: types.ModuleType, path: str) -> list[str]:
        if not _is_own(module.__name__):
            return [module.__name__, _version(module.__name__)]
        if file := _extension(module.__name__):
            return [hashlib.sha256(Path(file).read_bytes()).hexdigest()]
        names = sorted(n for n in vars(module) if not (n.startswith("__") and n.endswith("__")))
        return self._items({n: vars(module)[n] for n in names}, path)

    def _class(self, kind: type, path: str) -> list[str]:
        if _is_named(kind):
            return [_name(kind)]
        # the text of its whole file
        skipped = NOT_RUN | {"source"} if issubclass(kind, Block) else NOT_RUN
        held = {n: v for n, v in sorted(vars(kind).items()) if n not in skipped}
        if _extension(kind.__module__):
            return [kind.__qualname__, *self._module(sys.modules[kind.__module__], path)]
        return [
            kind.__qualname__,
            *self._all([type(kind), *kind.__bases__], path),
            *self._items(held, path),
        ]

    def _compiled(self, f: Any, path: str) -> list[str]:
        """Return the hash parts of a function that is not written in Python.

        They are its name and the object to which it is bound.
        """
        bound = getattr(f, "__self__", None)
        name = f.__name__
        if bound is builtins and name in BY_NAME:
            raise _by_name(path, name)
        if isinstance(f, np.ufunc) or getattr(np.random, name, None) is f:
            places: list[Any] = [np, np.random, sys.modules.get("scipy.special")]
            if not any(getattr(m, name, None) is f for m in places):
                raise _hidden(path, f)
        elif bound is not None and not isinstance(bound, types.ModuleType):
            return [f.__name__, self.of(bound, path)]
        elif isinstance(bound, types.ModuleType) and _is_own(bound.__name__):
            return [f.__name__, *self._module(bound, path)]
        return [f"{getattr(f, '__module__', '')}.{f.__name__}"]

    # Objects --------------------------------------------------------------------------
    def _instance(self, what: Any, path: str) -> list[str]:
        """Return the hash parts of an object: class, content and wrapped objects."""
        kind = type(what)
        name, holder = getattr(what, "__qualname__", None), getattr(what, "__module__", None)
        if isinstance(name, str) and isinstance(holder, str):  # compiled by Cython, say
            if _is_named(what):
                return [_name(what)]
            if _extension(holder):
                return [name, *self._module(sys.modules[holder], path)]
        parts = [self.of(kind, path)]
        if isinstance(what, set | frozenset):
            parts += sorted(self._all(list(what), path))
        if _is_own(kind.__module__):
            parts += self._items(_content(what), path)
            base = next(k for k in kind.__mro__ if not _is_own(k.__module__))
            if base in (object, set, frozenset):
                return parts
            return parts + self._reduced(what, base, path)
        return parts + (self._wrapped(what, path) or self._reduced(what, kind, path))

    def _wrapped(self, what: Any, path: str) -> list[str]:
        """Return the hash parts of a cached or compiled function, or nothing."""
        kind = type(what)
        if isinstance(what, functools._lru_cache_wrapper):
            # it has the attributes of another function
            if not any(f is what.__wrapped__ for f in gc.get_referents(what)):
                raise _hidden(path, what)
            return [self.of(vars(what), path)]
        if hasattr(what, "__wrapped__") and kind.__module__.partition(".")[0] == "numba":
            # else the signatures are those of the calls so far
            signatures = getattr(what, "_sig", "")
            if not getattr(what, "_can_compile", True):
                signatures = [c.signature for c in what.overloads.values()]
            options = getattr(what, "targetoptions", ""), getattr(what, "locals", ""), signatures
            return [repr(options), self.of(what.__wrapped__, path)]
        return []

    def _reduced(self, what: Any, base: Any, path: str) -> list[str]:
        """Return the hash parts of an object from its pickled form."""
        try:
            reduce: Any = dispatch_table.get(type(what))
            state = reduce(what) if reduce else base.__reduce_ex__(what, 4)
        except Exception:
            raise _hidden(path, what) from None
        if isinstance(state, str):
            found: Any = sys.modules.get(getattr(what, "__module__", ""))
            if getattr(found, state, None) is not what:
                raise _hidden(path, what)
            return [state, *(self._module(found, path) if _is_own(found.__name__) else ())]
        return self._all([list(v) if isinstance(v, Iterator) else v for v in state], path)


def _by_name(path: str, name: str) -> BadValue:
    return BadValue(
        f"{path}: uses {name}, so what it computes from cannot be seen; name the function or number"
        ' itself, or state @measure(.., version="1")'
    )


def _hash(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _content(what: Any) -> dict[str, Any]:
    """Return the attributes of an object, including those in slots."""
    held = {}
    for kind in type(what).__mro__:
        for name, member in vars(kind).items():
            if isinstance(member, types.MemberDescriptorType) and hasattr(what, name):
                held[name] = getattr(what, name)
    return held | dict(sorted(getattr(what, "__dict__", {}).items()))


# What code names ----------------------------------------------------------------------
def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for c in code.co_consts:
        if isinstance(c, types.CodeType):
            yield from _codes(c)


def _loaded(code: types.CodeType) -> set[str]:
    """Return the names of the global variables that code reads."""
    steps = [i for c in _codes(code) for i in dis.get_instructions(c)]
    return {i.argval for i in steps if i.opname in READS[:2]}


def _words(code: types.CodeType) -> set[str]:
    """Return all attribute names that code may use, including those in strings."""
    return {w for c in _codes(code) for w in (*c.co_names, *c.co_consts) if isinstance(w, str)}


def _whole(code: types.CodeType, name: str, value: types.ModuleType) -> Iterator[types.ModuleType]:
    """Yield the user's modules that code uses as a whole.

    The code knows ``value`` by ``name``; uses of a single attribute do not count.
    """
    for c in _codes(code):
        steps = [i for i in dis.get_instructions(c) if i.opname != "EXTENDED_ARG"]
        for at, i in enumerate(steps):
            if i.opname not in READS or i.argval != name:
                continue
            found: Any = value
            for after in steps[at + 1 :]:
                if after.opname not in ("LOAD_ATTR", "LOAD_METHOD") or after.argval == "__dict__":
                    if _is_own(found.__name__):
                        yield found
                    break
                found = vars(found).get(after.argval)
                if not isinstance(found, types.ModuleType):
                    break


def _imports(f: types.FunctionType) -> Iterator[tuple[str, types.ModuleType, set[str]]]:
    """Yield the modules, with their names, that a function imports when it runs."""
    package = f.__globals__.get("__package__") or ""
    for code in _codes(f.__code__):
        steps = [i for i in dis.get_instructions(code) if i.opname != "EXTENDED_ARG"]
        for at, i in enumerate(steps):
            if i.opname != "IMPORT_NAME":
                continue
            level, name = steps[at - 2].argval, i.argval
            if level:
                name = importlib.util.resolve_name("." * level + name, package)
            try:
                module = importlib.import_module(name)
            except ImportError:  # it may be meant: the function says what then
                continue
            wanted = set(steps[at - 1].argval or ())  # none where the module itself is imported
            for below in wanted - vars(module).keys():
                with suppress(ImportError):
                    importlib.import_module(f"{name}.{below}")
            for below in sorted(wanted & vars(module).keys()):
                if isinstance(vars(module)[below], types.ModuleType):
                    yield f"{name}.{below}", vars(module)[below], set()
            yield name, module, wanted
            top, _, below = name.partition(".")
            if below and not wanted:
                yield top, sys.modules[top], set()


# Of others ----------------------------------------------------------------------------
@functools.cache
def _installed(file: str) -> bool:
    path = Path(file)
    if {"site-packages", "dist-packages"} & {*path.parts}:
        return True
    return any(path.resolve().is_relative_to(folder) for folder in INSTALLED)


def _is_own(name: str) -> bool:
    """Return whether a module belongs to the user.

    This is a file outside installed packages, a script or a notebook.
    """
    if name in sys.builtin_module_names or name in sys.stdlib_module_names:
        return False
    module = sys.modules.get(name)
    held = getattr(module, "__dict__", {})
    files = [held.get("__file__") or "", *(held.get("__path__") or ())]
    return not any(_installed(file) for file in files if file)


def _extension(name: str) -> str:
    """Return the file of a user's compiled extension module, or an empty text."""
    file = getattr(sys.modules.get(name), "__file__", None) or ""
    return "" if file.endswith(".py") or not _is_own(name) else file


def _is_named(what: Any) -> bool:
    """Return whether an installed package has this same object under its name."""
    if _is_own(getattr(what, "__module__", None) or ""):
        return False
    found: Any = sys.modules.get(what.__module__)
    for part in what.__qualname__.split("."):
        found = getattr(found, part, None)
    return found is what


def _name(what: Any) -> str:
    return f"{what.__module__}.{what.__qualname__} {_version(what.__module__)}"


@functools.cache
def _distributions() -> Mapping[str, list[str]]:
    return importlib.metadata.packages_distributions()


def _version(name: str) -> str:
    top = name.partition(".")[0]
    stated = getattr(sys.modules.get(top), "__version__", None)
    if stated is None and top not in sys.stdlib_module_names:
        stated = [importlib.metadata.version(d) for d in sorted({*_distributions().get(top, ())})]
    return str(stated)
