"""A plugin of pytest that falsifies tests: each number that a test compares is 2 % off.

``PYTHONPATH=tests python -m pytest -p off ..`` changes the left side of ==, of a
difference and of an inequality in an assertion, the first argument of NumPy's
comparisons, and the samples that are held against the law of a block.  A test that
passes nevertheless compares no number, or holds it within more than 2 %.  The files of
tests are only changed in memory.

One case that fails is enough: others of its function are left out, and an example that
hypothesis finds is not made smaller.
"""

import ast
import builtins
import sys
import tempfile
from typing import Any

import numpy as np
import pytest
from _pytest.assertion import rewrite
from hypothesis import Phase, settings

from stimlib.checks import local

RED: set[str] = set()
"""Functions of which a case has failed."""
COMPARED = {
    "allclose",
    "array_equal",
    "isclose",
    "assert_allclose",
    "assert_array_equal",
    "assert_same",
}


def off(value: Any) -> Any:
    """Return a value of which each number is 2 % off, and 0 is 2 % of the largest off.

    What is no number stays, as do values that are true or false.
    """
    if isinstance(value, dict):
        return {key: off(v) for key, v in value.items()}
    if type(value) in (list, tuple, set) and any(isinstance(v, str) for v in value):
        return type(value)(off(v) for v in value)
    kind = np.asarray(value).dtype.kind if isinstance(value, (list, tuple, np.ndarray)) else ""
    if not kind and isinstance(value, (int, float, complex, np.number)):
        kind = np.asarray(value).dtype.kind
    if kind not in tuple("iufc"):
        return value
    numbers = np.asarray(value) * 1.0
    largest = float(np.max(abs(numbers), initial=0.0))
    changed = numbers * 1.02 + (numbers == 0) * 0.02 * (largest or 1.0)
    if isinstance(value, np.ndarray):
        return changed
    return type(value)(changed.tolist()) if isinstance(value, (list, tuple)) else changed[()]


class Falsify(ast.NodeTransformer):
    """Put the call of `off` around what an assertion compares."""

    def __init__(self) -> None:
        self.within = False

    def visit_Assert(self, node: ast.Assert) -> ast.Assert:
        self.within = True
        node.test = self.visit(node.test)
        self.within = False
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        if self.within and not isinstance(node.ops[0], (ast.In, ast.NotIn, ast.Is, ast.IsNot)):
            node.left = self.called(node.left)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if self.within and isinstance(node.op, ast.Sub):
            node.left = self.called(node.left)
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if name in COMPARED and node.args:
            node.args[0] = self.called(node.args[0])
        return node

    def called(self, node: ast.expr) -> ast.expr:
        return ast.copy_location(
            ast.Call(ast.Name("__off__", ast.Load()), [node], []),
            node,
        )


def pytest_configure() -> None:
    sys.pycache_prefix = tempfile.mkdtemp()  # what is falsified is kept for nobody
    written = rewrite.rewrite_asserts
    builtins.__off__ = off

    def falsified(mod: ast.Module, *args: Any, **words: Any) -> None:
        ast.fix_missing_locations(Falsify().visit(mod))
        written(mod, *args, **words)

    rewrite.rewrite_asserts = falsified


def pytest_sessionstart() -> None:  # after the profile of conftest.py
    words = {"phases": (Phase.explicit, Phase.generate), "report_multiple_bugs": False}
    settings.register_profile("off", settings(), **words)
    settings.load_profile("off")
    error = local._error
    local._error = lambda y, *of: error(off(y), *of)


@pytest.hookimpl(tryfirst=True)
def pytest_assertrepr_compare() -> list[str]:
    return ["off"]  # and no long difference of two arrays


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.nodeid.partition("[")[0] in RED:
        pytest.skip("another case has failed")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed:
        RED.add(report.nodeid.partition("[")[0])
