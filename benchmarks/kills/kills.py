"""Which tests kill which mutants of stimlib: draws mutants, runs the tests that execute
each changed line, the nearest and quickest first, and names mutants that live and test
functions that no mutant and no line needs.

    kills.py map [TESTS ..]       the suite, with lines and CPU of each test
    kills.py draw 600 7 [ROOM ..] 600 mutants by seed 7, of every room or of these
    kills.py run [ID ..]          what kills each; goes on where it stopped
    kills.py choose               rooms' scores; who lives; who may go
    kills.py tests FILE           which test functions run lines of stimlib/.../FILE

A map of some tests is enough for the rooms that they test: ``map tests/plate -n 1``.
Everything is kept in the folder KILLS (default: /tmp/kills), one for each draw.
``run`` changes the files of the work tree that it stands in and puts them back, so use
a tree of its own; ``run`` in K trees shares the work by PART=k/K.  Needs ``pip install
coverage``.
"""

from __future__ import annotations

import ast
import contextlib
import csv
import importlib
import json
import os
import random
import re
import resource
import select
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
KEPT = Path(os.environ.get("KILLS", "/tmp/kills"))
PACKAGE = ROOT / "stimlib"
LIVING = Path(__file__).parents[1] / "results" / "kills_living.csv"
CHANGE = "file", "where", "text", "before", "after"  # what names a mutant in it
LEAST = 15  # mutants of a room, where it has so many; the rest by lines of code
BUDGET = float(os.environ.get("BUDGET", "30"))  # CPU seconds of the tests of a mutant
MOST, LIMIT = 4 * int(BUDGET), 150.0 + BUDGET  # their number, and seconds until it hangs
TWICE = "constant", "comparison", "sign"
EDGE = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
OTHER = {ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In}
OTHER |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is}
TURNED = {ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE}
SIGN = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
DTYPE = {"float64": "float32", "float32": "float64", "int64": "int32", "int32": "int64"}
DTYPE |= {"uint64": "uint32", "uint8": "int8", "int16": "int32", "complex128": "complex64"}
DTYPE |= {"<f8": "<f4", "<f4": "<f8", "<i8": "<i4", "<i4": "<i8", "<u8": "<i8"}
SYMMETRIC = "isinstance", "max", "min", "getattr", "hasattr", "np.maximum", "np.minimum"

Row = dict[str, Any]


# Drawing ------------------------------------------------------------------------------
def binds_first(node: ast.stmt, function: Any) -> bool:
    """Whether dropping it ends in a NameError, which every test sees."""
    if not isinstance(node, ast.Assign) or function is None:
        return False

    def stored(tree: ast.AST) -> set[str]:
        return {
            n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }

    before = {a.arg for a in function.args.args + function.args.kwonlyargs}
    for n in ast.walk(function):
        if isinstance(n, ast.stmt) and n is not function and n.lineno < node.lineno:
            before |= (
                stored(n) if not isinstance(n, ast.For | ast.While | ast.If | ast.With) else set()
            )
    return not stored(node) <= before


def of_expression(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Kinds of change of an expression, and its text after each."""
    match node:
        case ast.Constant(value=float(v)):
            yield "constant", repr(v * 1.01 if v else 0.01)
            if v:
                yield "constant", "0.0"
        case ast.Constant(value=int(v)) if type(v) is int:
            yield "constant", repr(v + 1)
            if v:
                yield "constant", "0"
        case ast.Constant(value=str(v)) if v in DTYPE and v[0] == "<":
            yield "dtype", repr(DTYPE[v])
        case ast.Attribute(value=ast.Name(id=name), attr=attr) if attr in DTYPE:
            yield "dtype", f"{name}.{DTYPE[attr]}"
        case ast.Compare(left=left, ops=[op], comparators=right):
            for table in (EDGE, OTHER, TURNED):
                if new := table.get(type(op)):
                    yield "comparison", f"({ast.unparse(ast.Compare(left, [new()], right))})"
        case ast.BoolOp(op=op, values=values):
            new = ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
            yield "and/or", f"({ast.unparse(new)})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "and/or", f"({ast.unparse(operand)})"
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            yield "sign", f"({ast.unparse(operand)})"
        case ast.BinOp(left=left, op=op, right=right) if type(op) in SIGN:
            texts = ast.JoinedStr | ast.List | ast.Tuple
            if not any(
                isinstance(n, texts) or isinstance(n, ast.Constant) and isinstance(n.value, str)
                for n in (left, right)
            ):
                yield "sign", f"({ast.unparse(ast.BinOp(left, SIGN[type(op)](), right))})"
        case ast.Call(func=f, args=[a, b, *rest], keywords=k) if ast.dump(a) != ast.dump(b):
            name = ast.unparse(f)
            if name.endswith("where") and len(rest) == 1 and not k:
                new = ast.Call(f, [a, rest[0], b], [])
                yield "swapped arguments", ast.unparse(new)
            elif name not in SYMMETRIC and not {type(a), type(b)} & {ast.Starred, ast.JoinedStr}:
                yield "swapped arguments", ast.unparse(ast.Call(f, [b, a, *rest], k))
        case ast.Slice(lower=low, upper=up, step=step):
            one = ast.Constant(1)
            if low is not None:
                yield "slice", ast.unparse(ast.Slice(ast.BinOp(low, ast.Add(), one), up, step))
            if up is not None:
                yield "slice", ast.unparse(ast.Slice(low, ast.BinOp(up, ast.Sub(), one), step))


def sites(tree: ast.AST) -> Iterator[tuple[str, Any, str, str]]:
    """Kind, node, its text after the change and the function it stands in."""

    def visit(node: Any, where: str, names: list[str], inner: Any, held: Any) -> Any:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            if node.name in ("__repr__", "__str__"):
                return
            where = f"{where}.{node.name}".lstrip(".")
            if not isinstance(node, ast.ClassDef):
                inner = node
                args = {a.arg for a in node.args.args} - {"self", "cls"}
                names = sorted(
                    args
                    | {
                        n.id
                        for n in ast.walk(node)
                        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
                    }
                )
        for kind, after in of_expression(node):
            yield kind, node, after, where
        if isinstance(node, ast.Raise) and where:
            yield "removed raise", node, "pass", where
        elif isinstance(node, ast.Expr | ast.Assign | ast.AugAssign) and inner is not None:
            text = isinstance(node, ast.Expr) and isinstance(
                node.value, ast.Constant | ast.Yield | ast.YieldFrom
            )
            if not text and not isinstance(held, ast.ClassDef) and not binds_first(node, inner):
                yield "dropped statement", node, "pass", where
        elif isinstance(node, ast.Return) and isinstance(node.value, ast.Name):
            for name in names if node.value.id in names else ():
                if name != node.value.id:
                    yield "neighbour returned", node, f"return {name}", where
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list") or isinstance(
                node, ast.JoinedStr
            ):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from visit(child, where, names, inner, node)

    yield from visit(tree, "", [], None, None)


def changed(text: str, row: Row) -> str:
    """The text of a file with a mutant in it."""
    data = text.encode()
    start, end = row["start"], row["end"]
    if data[start:end].decode() != row["before"]:
        raise SystemExit(
            f"{row['file']}:{row['line']} is not what it was: put it back (git diff shows what"
            " changed), or draw again"
        )
    return (data[:start] + row["after"].encode() + data[end:]).decode()


def draw(count: int, seed: int, rooms: Collection[str] = ()) -> list[Row]:
    """So many mutants: of each room LEAST, the rest by its lines; kinds in turn."""
    rng = random.Random(seed)
    of_room: dict[str, dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    lines: Counter[str] = Counter()
    texts = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name, text = path.relative_to(ROOT).as_posix(), path.read_text()
        room = path.relative_to(PACKAGE).parts[0]
        room = "top" if room.endswith(".py") else room
        if rooms and room not in rooms:
            continue
        texts[name] = text
        lines[room] += text.count("\n")
        begins = [0]
        for line in text.encode().splitlines(keepends=True):
            begins.append(begins[-1] + len(line))
        for kind, node, after, where in sites(ast.parse(text)):
            start = begins[node.lineno - 1] + node.col_offset
            end = begins[node.end_lineno - 1] + node.end_col_offset
            of_room[room][kind].append(
                dict(room=room, file=name, line=node.lineno, end_line=node.end_lineno, kind=kind)
                | dict(where=where, before=text.encode()[start:end].decode(), after=after)
                | dict(text=text.splitlines()[node.lineno - 1].strip(), start=start, end=end)
            )
    if unknown := set(rooms) - lines.keys():
        sys.exit(f"stimlib has no room {', '.join(unknown)}; a room is a folder of it, or top")
    least = min(LEAST, count // len(of_room))
    rest, total = count - least * len(of_room), sum(lines.values())
    numbers = {room: least + round(rest * lines[room] / total) for room in sorted(of_room)}
    rows: list[Row] = []
    for room, many in numbers.items():
        taken: set[Any] = set()
        turn: list[str] = []
        tries = 0
        while len(taken) < many and (tries := tries + 1) < 50 * many:
            if not turn:
                turn = sorted(of_room[room]) + [k for k in TWICE if k in of_room[room]]
                rng.shuffle(turn)
            row = rng.choice(of_room[room][turn.pop()])
            key = row["file"], row["start"]
            with contextlib.suppress(SyntaxError):
                new = ast.dump(ast.parse(changed(texts[row["file"]], row)))
                if key not in taken and new != ast.dump(ast.parse(texts[row["file"]])):
                    taken.add(key)
                    rows.append({"id": f"{seed}-{len(rows)}"} | row)
    return rows


# Lines and CPU of each test -----------------------------------------------------------
def plain(test: str) -> str:
    """A test without the group that pytest-xdist adds to its name."""
    name, at, group = test.rpartition("@")
    return name if at and (group.endswith(".py") or group in ("jack", "browser")) else test


class Mapped:
    """A plugin that notes for each test that passes its lines and the CPU it took."""

    def __init__(self) -> None:
        from coverage import Coverage

        who = os.environ.get("PYTEST_XDIST_WORKER", "main")
        self.to = KEPT / f"{who}.lines"
        self.rows: list[tuple[str, float]] = []
        self.failed: set[str] = set()  # and what was skipped: neither kills anything
        self.lines = Coverage(data_file=str(self.to), source=[str(PACKAGE)], config_file=False)
        self.lines._warn = lambda *a, **k: None  # type: ignore[method-assign]
        self.lines.start()
        self.lines.switch_context("import")

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        self.lines.switch_context(plain(item.nodeid))
        began = spent()
        result = yield
        if item.nodeid not in self.failed:
            self.rows.append((item.nodeid, spent() - began))
        self.lines.switch_context("between")
        return result

    def pytest_runtest_logreport(self, report: Any) -> None:
        if not report.passed:
            self.failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.lines.stop()
        self.lines.save()
        self.to.with_suffix(".json").write_text(json.dumps(self.rows))


def spent() -> float:
    """CPU seconds of this process and of those that it started and that ended."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in both)


def pytest_configure(config: Any) -> None:
    """``pytest -p kills``: map what this process runs, if it runs tests itself."""
    if os.environ.get("PYTEST_XDIST_WORKER") or not config.getoption("numprocesses", None):
        config.pluginmanager.register(Mapped())


def mapped() -> tuple[dict[str, dict[int, list[int]]], list[str], list[float]]:
    """Tests that run each line of each file, by number; names and seconds of tests."""
    from coverage import CoverageData

    if not [*KEPT.glob("*.lines")]:
        sys.exit(f"{KEPT} has no map of the tests: run kills.py map first")
    seconds = {
        plain(test): s
        for path in sorted(KEPT.glob("*.json"))
        if path.with_suffix(".lines").exists()
        for test, s in json.loads(path.read_text())
    }
    names = sorted(seconds)
    number = {test: k for k, test in enumerate(names)}
    lines: dict[str, dict[int, list[int]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted(KEPT.glob("*.lines")):
        data = CoverageData(str(path))
        data.read()
        for file in data.measured_files():
            of_file = lines[Path(file).relative_to(data_root(file)).as_posix()]
            for line, tests in data.contexts_by_lineno(file).items():
                of_file[line] += [number[t] for t in tests if t in number]
    return lines, names, [seconds[t] for t in names]


def data_root(file: str) -> Path:
    """The tree of a measured file, which may be another than this one."""
    parts = Path(file).parts
    return Path(*parts[: len(parts) - 1 - parts[::-1].index("stimlib")])


# Running ------------------------------------------------------------------------------
def function_of(test: str) -> str:
    """A test without its parameters."""
    return test.partition("[")[0]


def words_of(path: str) -> set[str]:
    """The words of a path, those that all paths have left out."""
    return set(re.split(r"[/_.]", path)) - {"stimlib", "tests", "test", "py"}


class Chosen:
    """For each mutant the tests that run a changed line, and after them others that are
    near: first four of each function in files that are named like the changed one, then
    of each one before a second, the quickest first; those of functions in LAST at last.
    """

    def __init__(self, last: set[str]) -> None:
        self.lines, self.names, self.seconds = mapped()
        files = sorted({self.file(k) for k in range(len(self.names))})
        command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-n", "0"]
        command += [f for f in files if (ROOT / f).exists()]
        said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout
        self.there = set(said.splitlines())  # a map may be of other tests
        self.last = last

    def file(self, k: int) -> str:
        return self.names[k].partition("::")[0]

    def of(self, row: Row) -> list[str]:
        of_file = self.lines.get(row["file"], {})
        at = range(row["line"], row["end_line"] + 1)
        found = {k for line in at for k in of_file.get(line, ())}
        runs = set(found)
        stem, near = Path(row["file"]).stem, words_of(row["file"])
        every = {k for tests in of_file.values() for k in tests}
        # a step is compiled too, and a line may run at import alone
        found |= {k for k in every if not found or stem in words_of(self.file(k))}
        if len(found) < 10:  # run to compile: whoever runs its importers
            found |= {
                k
                for path in PACKAGE.rglob("*.py")
                if re.search(rf"\b{stem}\b", path.read_text())
                for tests in self.lines.get(path.relative_to(ROOT).as_posix(), {}).values()
                for k in tests
            }
        doubtful, chosen, total = Counter[str](), [], 0.0
        order = []
        found = {k for k in found if self.names[k] in self.there}
        for k in sorted(found, key=lambda k: (self.seconds[k], k)):
            name = function_of(self.names[k])
            words = words_of(self.file(k))
            own = stem in words and doubtful[name] < 4
            far = not own, doubtful[name], -len(near & words)
            order.append((name in self.last, k not in runs, far, self.seconds[k], k))
            doubtful[name] += 1
        for *_, s, k in sorted(order):
            if len(chosen) == MOST or total + s > BUDGET and chosen:
                break
            chosen.append(self.names[k])
            total += s
        return chosen


def preload() -> None:
    """What every child would import for itself."""
    for name in (
        "numpy scipy.signal scipy.optimize scipy.stats scipy.special scipy.integrate jax jax.numpy"
        " llvmlite.ir llvmlite.binding mpmath matplotlib.figure soundfile typer rich.console"
        " rich.progress rich.table pint pandas pytest"
    ).split():
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


class First:
    """A plugin that keeps the first test that fails, and why."""

    def __init__(self) -> None:
        self.failed: list[str] = []
        self.why = ""

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed.append(report.nodeid)
            self.why = str(getattr(report.longrepr, "reprcrash", None) or report.longrepr)[-300:]

    pytest_collectreport = pytest_runtest_logreport


def tried(tests: list[str], limit: float = LIMIT) -> Row:
    """What the tests say in a process of their own: the first that fails, or none."""
    ours, theirs = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.setsid()
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.close(ours)
            null = os.open(os.devnull, os.O_RDWR)
            for k in range(3):
                os.dup2(null, k)
            first = First()
            sys.dont_write_bytecode = True
            options = ["-x", "-q", "-p", "no:cacheprovider", "--tb=short", "-n", "0"]
            code = pytest.main([*options, *tests], plugins=[first])
            os.write(theirs, json.dumps([int(code), first.failed[:1], first.why]).encode()[:4000])
        finally:
            os._exit(0)  # never back to who forked, whose files it would put back
    os.close(theirs)
    began, data = time.monotonic(), b""
    try:
        while time.monotonic() - began < limit:
            if select.select([ours], [], [], 0.5)[0]:
                data = os.read(ours, 65536)
                break
    finally:  # also where this process is stopped
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(ours)
    if not data:  # it hung, or ended without a word: the first is what a mutant does, and is seen
        hung = time.monotonic() - began >= limit
        return {"by": "it hangs" if hung else "it crashes", "why": ""}
    code, failed, why = json.loads(data)
    by = failed[0] if failed else "" if code == 0 else f"pytest ends with {code}"
    return {"by": by, "why": why}


def run(ids: list[str]) -> None:
    """Runs the drawn mutants that have no result yet."""
    rows = json.loads((KEPT / "mutants.json").read_text())
    if unknown := set(ids) - {r["id"] for r in rows}:
        sys.exit(
            f"{KEPT} has no mutant {', '.join(sorted(unknown))}: they are {rows[0]['id']} to"
            f" {rows[-1]['id']}"
        )
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))  # and the file is put back
    part, parts = map(int, os.environ.get("PART", "0/1").split("/"))
    to = KEPT / f"results-{part}.jsonl"
    done = {r["id"] for path in KEPT.glob("results-*.jsonl") for r in read(path)}
    last = KEPT / "last.txt"
    chosen = Chosen(set(last.read_text().split()) if last.exists() else set())
    sys.path[0] = str(ROOT)  # the tree that is changed, before what is installed
    preload()
    os.chdir(ROOT)
    wanted = (
        [r for r in rows if r["id"] in ids]
        if ids
        else [r for r in rows if r["id"] not in done][part::parts]
    )
    for row in wanted:
        path = ROOT / row["file"]
        clean, times = path.read_text(), path.stat()
        tests = chosen.of(row)
        began = time.monotonic()
        try:
            path.write_text(changed(clean, row))
            result = tried(tests) if tests else {"by": "", "why": "no test runs it"}
        finally:
            path.write_text(clean)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        if result["by"] and "::" not in result["by"] and tried(tests)["by"] == result["by"]:
            result = {"by": "", "why": f"{result['by']}, and so does the clean code"}
        result |= {"id": row["id"], "tests": len(tests), "s": round(time.monotonic() - began, 1)}
        with to.open("a") as file:
            file.write(json.dumps(result) + "\n")
        print(
            row["id"],
            f"{row['file']}:{row['line']}",
            row["kind"],
            result["s"],
            result["by"] or "LIVES",
            flush=True,
        )


# Judging -----------------------------------------------------------------------------
def choose() -> None:
    """Prints the score of every room, the mutants that live with the reasons given in
    LIVING, and the test functions without which no line and no mutant is missed.
    """
    rows = {r["id"]: r for r in json.loads((KEPT / "mutants.json").read_text())}
    results = {r["id"]: r for path in sorted(KEPT.glob("results-*.jsonl")) for r in read(path)}
    reasons = {}
    if LIVING.exists():
        with LIVING.open(newline="") as file:
            reasons = {tuple(r[c] for c in CHANGE): r for r in csv.DictReader(file)}
    score: dict[str, Counter[str]] = defaultdict(Counter)
    for key, result in results.items():
        outcome = "caught" if result["by"] else "lives"
        known = reasons.get(tuple(rows[key][c] for c in CHANGE), {})
        if outcome == "lives" and known.get("change") == "none":
            outcome = "equal"
        score[rows[key]["room"]][outcome] += 1
        if outcome == "lives":
            row = rows[key]
            where = f"{row['file']}:{row['line']} {row['where']}"
            print(
                key,
                where,
                f"{row['before']!r} -> {row['after']!r}",
                known.get("reason", ""),
            )
    for room, counts in sorted(score.items()) + [("all", sum(score.values(), Counter()))]:
        caught, lives = counts["caught"], counts["lives"]
        share = caught / max(1, caught + lives)
        print(
            f"{room:12s} caught {caught:4d} lives {lives:3d} equal {counts['equal']:3d} {share:.1%}"
        )
    lines, names, seconds = mapped()
    of_function: dict[str, set[Any]] = defaultdict(set)
    cost: Counter[str] = Counter()
    for file, of_file in lines.items():
        for line, tests in of_file.items():
            for k in tests:
                of_function[function_of(names[k])].add((file, line))
    for name, s in zip(names, seconds, strict=True):
        cost[function_of(name)] += s
    needed = {function_of(r["by"]) for r in results.values()}
    covered = set().union(*(of_function[name] for name in needed if name in of_function))
    for name in sorted(cost, key=lambda name: cost[name]):
        if name not in needed and not of_function[name] <= covered:
            needed.add(name)
            covered |= of_function[name]
    free = sorted(cost.keys() - needed, key=lambda name: -cost[name])
    seconds_free, all_seconds = sum(cost[n] for n in free), sum(cost.values())
    print(
        f"By these {len(results)} mutants {len(free)} of {len(cost)} functions may go, unless they"
        f" make a claim of their own, {seconds_free:.0f} of {all_seconds:.0f} s; less than some"
        " hundred mutants say little:"
    )
    for name in free:
        print(f"{cost[name]:7.2f} {name}")


def tests_of(file: str) -> None:
    """Prints the test functions that run lines of a file, those of most lines first."""
    lines, names, seconds = mapped()
    found: dict[str, set[int]] = defaultdict(set)
    cost: Counter[str] = Counter()
    for line, tests in lines.get(file, {}).items():
        for k in tests:
            found[function_of(names[k])].add(line)
    for name, s in zip(names, seconds, strict=True):
        cost[function_of(name)] += s
    if not found:
        sys.exit(
            f"no test of the map in {KEPT} runs a line of {file} (a path such as"
            " stimlib/plate/model.py): map its tests"
        )
    for name in sorted(found, key=lambda name: (-len(found[name]), cost[name])):
        print(f"{len(found[name]):4d} lines {cost[name]:7.2f} s  {name}")


def read(path: Path) -> list[Row]:
    """The rows of a file of results."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def main(what: str = "", *words: str) -> None:
    """One step; see above."""
    least = {"map": 0, "draw": 2, "run": 0, "choose": 0, "tests": 1}
    if len(words) < least.get(what, len(words) + 1):
        sys.exit(__doc__)
    if not find_spec("coverage"):
        sys.exit("kills.py needs coverage: pip install coverage")
    KEPT.mkdir(parents=True, exist_ok=True)
    if what in ("run", "choose") and not (KEPT / "mutants.json").exists():
        sys.exit(f"{KEPT} has no mutants: run kills.py draw first")
    if what == "map":
        for path in KEPT.glob("*.lines"):  # of an earlier map
            path.unlink()
        command = [sys.executable, "-m", "pytest", "-q", "-n", "3", "--dist", "loadgroup"]
        os.environ["PYTHONPATH"] = os.pathsep.join(
            [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
        )
        os.chdir(ROOT)
        os.execv(command[0], [*command, "--no-loadscope-reorder", "-p", "kills", *words])
    elif what == "draw":
        if [*KEPT.glob("results-*.jsonl")]:
            sys.exit(f"{KEPT} has results of other mutants: name another folder by KILLS")
        if not (words[0].isdecimal() and words[1].isdecimal()):
            sys.exit(
                f"draw {words[0]} {words[1]}: give the number of mutants and a seed, draw 12 7"
            )
        rows = draw(int(words[0]), int(words[1]), words[2:])
        (KEPT / "mutants.json").write_text(json.dumps(rows, indent=1))
        print(Counter(r["room"] for r in rows), Counter(r["kind"] for r in rows), sep="\n")
    elif what == "run":
        run(list(words))
    else:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # it may be read by head
        choose() if what == "choose" else tests_of(words[0])


if __name__ == "__main__":
    main(*sys.argv[1:])
