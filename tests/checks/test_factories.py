"""A scene's function with a wrong number in it: each use of each number a quarter
larger, one at a time, and `verify` refuses it.

``python tests/checks/test_factories.py`` prints what becomes of each.
"""

import __future__

import ast
import functools
import inspect
import sys
import warnings

import numpy as np
import pytest
from checks.test_parts import hands
from laws import STRESS

import stimlib
from stimlib.errors import StimlibError, public
from stimlib.scenes import SHIPPED
from stimlib.scenes.shipped import lawful

FS, SECONDS = 4000, 0.4
WORDS = {  # arguments under which more of a function is used
    "squeeze": [{"fingers": 1}, {"fingers": 1, "limits": True, "motor_constant": 10.0}],
    "bumps": [
        {"phase": 0.3},
        {"rectify": "full", "limit": 150.0},
        {"displacement": ([0.0, 0.05, 0.1], [1.0, 1.5, 1.0]), "limit": 150.0, "headroom": "scale"},
    ],
    "soft_surface": [{}, {"mode": "multipoint"}, {"device": "mouse"}],
    "wall": [{"at": 1e-4}],
    "impact": [{"b": 1.0}],
    "viscoelastic": [{}, {"scheme": "gl-short-memory"}],
    "touch_screen": [{}, {"rectify": "half", "amplitude": 4.0}],
}
MOTION = {  # where the inputs must be for it
    "squeeze": {"x1": lambda t: 0.06 * np.minimum(10 * t, 1.0) ** 2},
    "soft_surface": {
        "x": lambda t: 0.06 + 0.01 * t,
        "y": lambda t: 0.06 + 0.1 * t,
        "press": lambda t: 0.5 + 0.5 * np.sin(9 * t),
    },
    "touch_screen": {"x": lambda t: 0.25 * t},
}


class Change(ast.NodeTransformer):
    """The k-th use of a number a quarter larger; of a whole number one more."""

    def __init__(self, k, kinds):
        self.k, self.kinds, self.uses, self.said = k, kinds, 0, ""

    def _use(self, node, whole=False):
        self.uses += 1
        if self.uses - 1 != self.k:
            return node
        return ast.Call(ast.Name("more" if whole else "larger", ast.Load()), [node], [])

    def visit(self, node):
        before = self.uses
        node = super().visit(node)
        if isinstance(node, ast.stmt) and not self.said and before <= self.k < self.uses:
            self.said = ast.unparse(node)
        return node

    def visit_Name(self, node):
        kind = self.kinds.get(node.id)
        return (
            node
            if kind is None or not isinstance(node.ctx, ast.Load)
            else self._use(node, kind is int)
        )

    def visit_Constant(self, node):
        return self._use(node) if type(node.value) is float and node.value else node


@functools.cache
def function_of(name):
    make = SHIPPED[name]
    module = ast.parse(inspect.getsource(sys.modules[make.__module__]))
    body = next(n for n in module.body if isinstance(n, ast.FunctionDef) and n.name == name)
    body.decorator_list = [ast.Name("public"), ast.Name("lawful")]  # a mutant is not shipped
    numbers = {"float": float, "int": int, "float | None": float}
    kinds = {
        p.name: numbers[p.annotation]
        for p in inspect.signature(make).parameters.values()
        if p.annotation in numbers
    }
    return make, ast.unparse(body), kinds


def mutant(name, k):
    """The function with its k-th number changed, and the statement that it is in; None
    behind the last.
    """
    make, text, kinds = function_of(name)
    tree, change = ast.parse(text), Change(k, kinds)
    for i, statement in enumerate(tree.body[0].body):
        if not any(
            word in ast.unparse(statement)
            for word in ("above_zero", "raise ", "bounds.check", "_warn")
        ):
            tree.body[0].body[i] = change.visit(statement)
    if not change.said:
        return None
    space = vars(sys.modules[make.__module__]) | {"public": public, "lawful": lawful}
    space |= {"larger": lambda v: v and 1.25 * v, "more": lambda v: v + 1}
    exec(
        compile(
            ast.fix_missing_locations(tree), name, "exec", __future__.annotations.compiler_flag
        ),
        space,
    )
    return space[name], change.said


def tried(name, k, words):
    """What becomes of a mutant: "same", "refused", "passed", or the error that it
    raises; and its statement.
    """
    wrong, said = mutant(name, k)
    every = MOTION.get(name) or hands(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        scene = SHIPPED[name](**words)
        right = stimlib.render(scene, {n: every[n] for n in scene.inputs}, FS, SECONDS)
        try:
            scene = wrong(**words)
            motion = {n: every.get(n, every.get("x1")) for n in scene.inputs}
            y = stimlib.render(scene, motion, FS, SECONDS)
        except StimlibError as e:
            return f"error {e}", said
        if np.array_equal(y.y, right.y) and scene.params.keys() == right.scene.params.keys():
            return "same", said
        return "passed" if stimlib.verify(scene, motion, y).passed else "refused", said


def uses(name):
    k = 0
    while mutant(name, k):
        k += 1
    return range(k)


@pytest.mark.longer
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.stress] * (n == "touch_screen")) for n in SHIPPED]
)
def test_a_wrong_number_in_a_factory_is_refused(name):
    """In `make test`, of a long function each third use, one variant of the arguments
    after the other.
    """
    variants, every = WORDS.get(name, [{}]), uses(name)
    cases = [(k, words) for words in variants for k in every]
    if not STRESS and len(every) > 9:
        cases = [(k, variants[i % len(variants)]) for i, k in enumerate(every[1::3])]
    found = [(k, words, *tried(name, k, words)) for k, words in cases]
    assert [row for row in found if row[2] == "passed"] == []
    assert sum(row[2] == "refused" for row in found) >= len(found) / 4


if __name__ == "__main__":
    for scene in SHIPPED:
        for words in WORDS.get(scene, [{}]):
            for k in uses(scene):
                print(scene, k, words, *tried(scene, k, words))
