"""The rooms of the house: imports point one way, and nobody takes what a module of
another room keeps for itself.
"""

import ast
import importlib
import re
from functools import cache
from pathlib import Path

STIMLIB = Path(__file__).parents[1] / "stimlib"
ROOMS = (
    "errors version above system core design blocks targets motion run plate soft scenes export"
    " files devices fitting analysis checks sweep experiments demo live cli"
)
ORDER = [*ROOMS.split(), "__main__"]
MODULES = {".".join(p.relative_to(STIMLIB).with_suffix("").parts): p for p in STIMLIB.rglob("*.py")}


@cache
def nodes(module: str) -> list[ast.AST]:
    """What its text says of others: imports, and constants."""
    tree = ast.parse(MODULES[module].read_text())
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
    page = (STIMLIB.parent / "docs" / "explanation" / "architecture.rst").read_text()
    return page.partition(f"\n{heading}\n")[2].partition("\nWhere something new goes\n")[0]


def test_every_room_has_its_sentence_in_the_order_of_imports():
    table = table_of("Rooms")
    assert re.findall(r"^``(\w+)`` +\w", table, re.M) == ORDER[:-1], (
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
        texts = {n.value for n in nodes(module) if isinstance(n, ast.Constant)}
        assert not texts & named, module


def test_no_module_imports_itself_by_a_detour():
    way: list[str] = []
    done: set[str] = set()

    def walk(module: str) -> None:
        assert module not in way, " -> ".join([*way[way.index(module) :], module])
        if module in done or module not in MODULES:
            return
        way.append(module)
        for target, _ in imports(module):
            walk(target)
        done.add(way.pop())

    for module in MODULES.keys() - {"__init__"}:
        walk(module)
