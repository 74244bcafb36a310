"""Sources that rest where nobody hears them.

The tone of ``burst * oscillator`` need not run between the bursts, nor the side of
``where`` that is not chosen.  A source may rest if its state is a function of the
sample index, as the phase of a tone and the counter of white noise are, since it can be
found again after the rest.  Pink noise, and whatever else a filter makes, runs on;
``enabled`` stops it, on a clock of its own.

A product with a source that may rest is never -0: so its bits do not depend on whether
the source did, which may have been heard elsewhere.
"""

from __future__ import annotations

import dataclasses as dc
import graphlib
from collections.abc import Callable

from .clocks import Node
from .graph import Add, Block, Const, Map, Mul, Neg, Product, Sub, unitless
from .maths import where
from .parameter import Param
from .pointwise import Where


@dc.dataclass(frozen=True, eq=False)
class Sounding(Map, in_files=False):
    """A signal that is 1 where a product with x may differ from 0, else 0.

    NaN counts, as a product with it is NaN.
    """

    x: Block

    units = unitless

    @staticmethod
    def step(p, s, x):
        return where(x == 0.0, 0.0, 1.0), s


@dc.dataclass(frozen=True, eq=False)
class Otherwise(Map, in_files=False):
    """A signal that is 1 where ``where`` takes its last signal, else 0."""

    c: Block

    units = unitless

    @staticmethod
    def step(p, s, c):
        return where(c > 0.0, 0.0, 1.0), s


@dc.dataclass(frozen=True, eq=False)
class RestingMul(Product, in_files=False):
    """The product a b of a source that may rest; it is +0 where b is 0."""

    @staticmethod
    def step(p, s, a, b):
        return a * b + 0.0, s


LINEAR, ALWAYS = (Add, Sub, Mul, Neg), Const(1.0)
# When a node is heard: the node that says so, and the class that makes a contact of it.
Contact = tuple[int, type[Map] | None]


def silenced(nodes: list[Node], roots: list[int], number: Callable[..., int]) -> list[int] | None:
    """Return the roots of a graph whose sources rest where nobody hears them.

    Return None if it has no such source.  Children come first in ``nodes``;
    number(block, kids) numbers the nodes of the new graph.
    """
    contacts, products = _contacts(nodes, roots)
    resting: dict[int, tuple[Block, int, Block]] = {}
    for node, contact in contacts.items():
        if contact is not None:
            by, make = contact
            heard: Block = make(nodes[by].block) if make else nodes[by].block
            if (block := nodes[node].block.resting(heard)) is not None:
                resting[node] = block, by, heard
    if not resting and not products:
        return None
    needs = {node: {*nodes[node].kids} for node in contacts}
    for node, (_, by, _) in resting.items():
        needs[node].add(by)
    new: dict[int, int] = {}
    # no cycle: of what a contact is made, something else is heard, or always
    for node in graphlib.TopologicalSorter(needs).static_order():
        block, kids = nodes[node].block, tuple(new[kid] for kid in nodes[node].kids)
        if node in resting:
            block, by, heard = resting[node]
            last = new[by] if heard is nodes[by].block else number(heard, (new[by],))
            kids = (*kids[: len(block.children) - 1], last)
        elif node in products:
            block = RestingMul(*block.children)
        new[node] = number(block, kids)
    return [new[node] for node in roots]


def _contacts(nodes: list[Node], roots: list[int]) -> tuple[dict[int, Contact | None], set[int]]:
    """Return when each node of a graph is heard, and the products with sources.

    None: always, or nobody knows.  What lies between a source and its product are sums
    and products, in which a 0 in place of the source stays finite.  Of two factors that
    are 0 only where a parameter is, neither waits for the other, which might do so too.
    """
    rests: set[int] = set()
    sources: set[int] = set()
    products: set[int] = set()
    waits: set[int] = set()  # with a source that rests if what is above lets it
    bursts: set[int] = set()  # what rests, whatever is above
    for node, (block, kids) in enumerate(nodes):
        source, linear = block.resting(ALWAYS) is not None, isinstance(block, LINEAR)
        if source or (linear and not sources.isdisjoint(kids)):
            sources.add(node)
        gated = isinstance(block, Mul) and not bursts.isdisjoint(kids)
        if source or (linear and not gated and not waits.isdisjoint(kids)):
            waits.add(node)
        if block.rests:
            rests.add(node)
        elif isinstance(block, Mul) and not rests.isdisjoint(kids):
            rests.add(node)
            if any(a in sources and b in rests for a, b in (kids, kids[::-1])):
                products.add(node)
        if node in rests and node not in waits and not isinstance(block, Param):
            bursts.add(node)
    found: dict[int, Contact | None] = dict.fromkeys(roots)
    for node in range(len(nodes) - 1, -1, -1):
        if node not in found:
            continue
        block, kids = nodes[node]
        heard = found[node] if isinstance(block, LINEAR) else None
        mutual = all(kid in rests and kid in waits for kid in kids)
        for place, kid in enumerate(kids):
            contact, other = heard, kids[place - 1]
            if isinstance(block, Where) and place and not isinstance(nodes[kids[0]].block, Const):
                contact = kids[0], Otherwise if place == 2 else None
            elif isinstance(block, Mul) and other in rests and not mutual:
                # a parameter may be 0, but a burst mostly is
                if heard is None or not isinstance(nodes[other].block, Param):
                    contact = other, Sounding
            found[kid] = contact if found.setdefault(kid, contact) == contact else None
    return found, products
