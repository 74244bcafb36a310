"""The rooms of the house: imports point one way, also around the package, and nobody
takes what a module of another room keeps for itself.
"""

import ast
import importlib
import re
from collections.abc import Callable, Hashable, Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
STIMLIB = ROOT / "stimlib"
ROOMS = (
    "errors version above system core design blocks targets motion run plate soft scenes export"
    " files devices fitting analysis virtual checks sweep experiments demo live cli"
)
ORDER = [*ROOMS.split(), "__main__"]
# what is around the package: each imports only from its own and those to its left
AROUND = ["docs", "examples", "helpers of tests", "benchmarks", "tests"]
MODULES = {".".join(p.relative_to(STIMLIB).with_suffix("").parts): p for p in STIMLIB.rglob("*.py")}


@cache
def nodes(module: str) -> list[ast.AST]:
    """What its text says of others: imports, and constants."""
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    return [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom | ast.Constant)]


@cache
def imports(module: str) -> set[tuple[str, str]]:
    """(module, name) of everything that a module imports of stimlib, also inside
    functions and for type checkers.
    """
    found = set()
    for node in nodes(module):
        if isinstance(node, ast.ImportFrom):
            target = node.module or ""
            if node.level:
                target = ".".join([*module.split(".")[: -node.level], *filter(None, [node.module])])
            elif target.split(".")[0] == "stimlib":
                target = target.partition(".")[2]
            else:
                continue
            for a in node.names:
                full = f"{target}.{a.name}" if target else a.name
                found.add(
                    (full, "")
                    if full in MODULES or f"{full}.__init__" in MODULES
                    else (target, a.name)
                )
    return found


def room(module: str) -> str:
    return module.partition(".")[0]


def test_every_room_has_its_floor():
    assert {room(m) for m in MODULES} - {"__init__"} == set(ORDER)


def table_of(heading: str) -> str:
    """A table of the page on architecture."""
    page = (ROOT / "docs" / "explanation" / "architecture.rst").read_text(encoding="utf-8")
    return page.partition(f"\n{heading}\n")[2].partition("\nWhere something new goes\n")[0]


def test_every_room_has_its_sentence_in_the_order_of_imports():
    assert re.findall(r"^``(\w+)`` +\w", table_of("Rooms"), re.M) == ORDER[:-1], (
        "docs/explanation/architecture.rst, Rooms: a line for each of ROOMS, in their order"
    )


def test_the_page_on_architecture_names_what_is_there():
    names = re.findall(r"``([\w.]+\.\w+)``", table_of("Where something is"))
    assert len(names) >= 12
    for name in names:
        module, _, what = name.rpartition(".")
        assert hasattr(importlib.import_module(f"stimlib.{module}"), what), f"{name} has moved"


def test_imports_point_down():
    wrong = []
    for module in sorted(MODULES.keys() - {"__init__"}):
        for target, name in imports(module):
            if not target:
                wrong.append(f"{module} imports {name} from the package itself")
            elif room(target) != room(module):
                if ORDER.index(room(target)) >= ORDER.index(room(module)):
                    wrong.append(f"{module} imports {target} from above")
                if name != "__version__" and f".{name}".startswith("._"):
                    wrong.append(f"{module} takes {name}, which {target} keeps for itself")
    assert not wrong, "\n".join(wrong)


def test_no_module_names_another_one_in_a_text():
    """What lower rooms call of upper ones is stated in the package; see above.py."""
    named = {"stimlib." + m.removesuffix(".__init__") for m in MODULES}
    for module in MODULES.keys() - {"__init__"}:
        assert not {n.value for n in nodes(module) if isinstance(n, ast.Constant)} & named, module


def without_detours(modules: Iterable[Hashable], imported: Callable[..., Iterable]) -> None:
    """Fail where a module imports itself, however many are between."""
    way: list = []
    done = set()

    def walk(module) -> None:
        assert module not in way, " -> ".join(map(str, [*way[way.index(module) :], module]))
        if module in done:
            return
        way.append(module)
        for target in imported(module):
            walk(target)
        done.add(way.pop())

    for module in modules:
        walk(module)


def test_no_module_imports_itself_by_a_detour():
    without_detours(
        MODULES.keys() - {"__init__"}, lambda m: {t for t, _ in imports(m)} & MODULES.keys()
    )


def around() -> list[Path]:
    """The Python files of the repository beside the package."""
    folders = ("docs", "examples", "tests", "benchmarks")
    return [p for f in folders for p in (ROOT / f).rglob("*.py") if "_build" not in p.parts]


@cache
def files_of(path: Path) -> set[Path]:
    """What a file beside the package imports of others beside the package."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module or ''}.{a.name}".lstrip(".") for a in node.names]
            names += [node.module] * bool(node.module)
        elif isinstance(node, ast.Call) and "import_module" in vars(node.func).values():
            names = [a.value for a in node.args if isinstance(a, ast.Constant)]
        else:
            continue
        for place in (path.parent, ROOT / "tests", ROOT / "benchmarks"):
            parts = [place.joinpath(*name.split(".")) for name in names]
            files = [f for p in parts for f in (p.with_suffix(".py"), p / "__init__.py")]
            if there := {f for f in files if f.is_file()}:
                found |= there
                break
    return found - {path}


def floor(path: Path) -> int:
    folder = path.relative_to(ROOT).parts[0]
    of_pytest = path.name == "conftest.py" or path.name.startswith("test_")
    return AROUND.index("helpers of tests" if folder == "tests" and not of_pytest else folder)


def test_what_is_around_the_package_imports_one_way_and_never_itself():
    wrong = [
        f"{path.relative_to(ROOT)} imports {target.relative_to(ROOT)}"
        for path in around()
        for target in files_of(path)
        if floor(target) > floor(path)
    ]
    assert not wrong, "\n".join(wrong)
    without_detours(around(), files_of)
