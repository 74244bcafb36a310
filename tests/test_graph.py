"""Building graphs: units, names, mistakes that are found where they are written, and
what is printed.
"""

import re
from dataclasses import dataclass

import numpy as np
import pint
import pytest
from hypothesis import given, settings, strategies as st
from laws import STRESS
from refusals import refused

import stimlib
from stimlib import (
    BadValue,
    Input,
    Param,
    Scene,
    SceneError,
    StimlibError,
    UnitError,
    blocks,
    constant,
)
from stimlib.blocks import carrier
from stimlib.core.graph import Block, Mul, reach, registry
from stimlib.core.units import ONE, pretty, unit

x, v, n = Input("x", "m"), Input("v", "m/s"), Input("n")


# Units --------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "make",
    [
        lambda: x + v,
        lambda: x - v,
        lambda: x > v,
        lambda: x <= v,
        lambda: blocks.maximum(x, v),
        lambda: blocks.where(n, x, v),
        lambda: blocks.clip(x, v, 0.0),
    ],
)
def test_unit_errors_name_both_nodes(make):
    error = refused(UnitError, None, make)
    assert isinstance(error, ValueError) and isinstance(error, StimlibError)
    for part in ("[m] ", "[m/s] ", "Input('x', 'm')", "Input('v', 'm/s')"):
        assert part in str(error)


def test_a_bare_number_hints_at_constant_and_a_literal_zero_fits_everywhere():
    refused(UnitError, r"write constant\(0.5, 'm'\)", lambda: x + 0.5)
    refused(UnitError, r"write constant\(2, 'm/s'\)", lambda: 2 > v)
    assert (x + 0).dim == (0 - x).dim == blocks.where(n, x, 0.0).dim == unit("m")
    assert (v > 0).dim == ONE


@pytest.mark.parametrize(
    ("make", "dim"),
    [
        (lambda: x * v, "m**2/s"),
        (lambda: x / v, "s"),
        (lambda: v / x, "1/s"),
        (lambda: -x, "m"),
        (lambda: abs(v), "m/s"),
        (lambda: constant(3.0, "N/m") * x, "N"),
        (lambda: 2 / x, "1/m"),
        (lambda: blocks.sqrt(x * x), "m"),
        (lambda: x > 0, ""),
        (lambda: blocks.velocity(x), "m/s"),
        (lambda: blocks.differentiator(v), "m/s**2"),
        (lambda: blocks.delay(v, 3), "m/s"),
        (lambda: blocks.fir(x, [1.0], "N/m"), "N"),
        (lambda: blocks.lut(x, [0, 1], [1, 2], unit="V"), "V"),
        (lambda: blocks.pinking(x), "m"),
        (lambda: blocks.first_order(x, 1.0), "m"),
        (lambda: blocks.loading(blocks.velocity(x)), ""),
        (lambda: blocks.kelvin_voigt(x, 1.0, 2.0), "N"),
        (lambda: blocks.enabled(constant(2.0, "N"), by=n), "N"),
        (lambda: blocks.nonzero(x), ""),
        (lambda: blocks.white_noise(1) * x, "m"),
    ],
)
def test_units_follow(make, dim):
    assert make().dim == unit(dim)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mm", ["'m'", "0.001"]),
        ("kN", ["1000", "SI"]),
        ("furlongs_per", ["unknown"]),
        ("m/", ["unknown"]),
        ("hour", ["3600"]),
        ("Ns/m", ["use 'N*s/m'"]),
        ("dB", ["logarithm of a ratio", "10**(dB/20)"]),
        ("m/s2", ["unknown", "write 'm/s**2'"]),
        *[(text, []) for text in ("m/0", "nan*m", "inf", "(-1)**0.5", "degC", "%")],
    ],
)
def test_prefixes_and_unknown_units_say_what_to_use(text, words):
    error = refused(UnitError, None, Input, "x", text)
    assert all(w in str(error) for w in [*words, repr(text)])


@pytest.mark.parametrize("text", ["\0", "\ud800", None, 3, ["m"], unit])
def test_a_unit_is_a_text_that_can_be_shown(text):
    says = None if isinstance(text, str) else "unit: text = .* must be a text"
    assert str(refused((UnitError, BadValue), says, unit, text)).isprintable()
    refused((UnitError, BadValue), None, Input, "q", text)


@pytest.mark.filterwarnings("ignore::SyntaxWarning", "ignore::DeprecationWarning")
@settings(max_examples=1000 if STRESS else 50)
@given(
    st.one_of(
        st.text(max_size=30),
        st.lists(
            st.sampled_from(
                'm s N kg / * ** ( ) 0 1 2 .5 - + mm nan inf e % ^ _ [ ] " , = if'.split()
            ),
            max_size=9,
        ).map(" ".join),
        st.lists(
            st.sampled_from(["m", "s", "N", "/", "*", "**", "^", "(", ")", "0", "1", "-"]),
            max_size=9,
        ).map("".join),
    )
)
def test_any_text_is_a_unit_or_an_error_of_ours(text):
    try:
        assert unit(str(unit(text))) == unit(text)
    except UnitError:
        pass


def test_transcendental_functions_and_impedances_want_their_units():
    for f in (blocks.exp, blocks.log, blocks.sin, blocks.cos, blocks.tanh):
        refused(UnitError, "must have no unit", f, x)
        f(x / constant(1.0, "m"))
    refused(UnitError, "not a force", blocks.spring, v, 3.0)
    refused(UnitError, None, blocks.kelvin_voigt, x, 3.0, Param("b", 1.0, "N/m"))


def test_products_of_the_usual_names_are_what_pint_says():
    known = pint.UnitRegistry()
    names = "kg m s A N Pa J W V Hz rad".split()
    for text in [
        f"{a}{op}{b}{n}/s" for a in [*names, "1"] for b in names for op in "*/" for n in ("", "**2")
    ]:
        base = known.Quantity(1.0, text).to_base_units()
        assert base.magnitude == 1.0
        assert dict(unit(text).powers) == {
            str(u): p for u, p in base.unit_items() if str(u) != "radian"
        }, text


def test_units_print_as_the_field_writes_them():
    assert [str(unit(u)) for u in ("kg*m/s**2", "N/m", "V", "N*s/m", "1/s", "")] == [
        "N",
        "N/m",
        "V",
        "N*s/m",
        "1/s",
        "1",
    ]
    printed = {"m/s**2": "m/s²", "N*s/m": "N·s/m", "kg*m**2/s**2/A": "kg·m²·s⁻²·A⁻¹", "m/m": "1"}
    for text, wanted in (printed | {"1/m**12": "m⁻¹²"}).items():
        assert sorted(f"{unit(text)}".split("·")) == sorted(wanted.split("·"))
        assert unit(f"{unit(text)}") == unit(text)  # pint reads it back
    assert f"{unit('m') ** 0.5}|{unit('V'):>3}" == "m^0.5|  V"
    assert pretty("(m/s^2)^2/Hz") == "(m/s²)²/Hz" and pretty("s^-0.25") == "s^-0.25"
    assert repr(Scene({"a": Input("a", "m/s^2")})) == "Scene(a [m/s²] -> a [m/s²])"
    assert unit(str(unit("m**2*A/s"))) == unit("m**2*A/s")
    assert unit(str(unit("m") ** 0.5)) == unit("m") ** 0.5


# Mistakes -----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda p: blocks.velocity(x, cutoff=p), "velocity: cutoff"),
        (lambda p: blocks.delay(x, samples=p), "delay: samples"),
        (lambda p: blocks.loading(v, on=p, off=0.1), "loading: on"),
        (lambda p: blocks.pink_noise(p, 1), "pink_noise: psd_1hz"),
        (lambda p: blocks.white_noise(p), "white_noise: seed"),
        (lambda p: Param("q", p), "Param.value"),
    ],
)
def test_a_live_number_in_a_design_field_is_an_error_that_names_it(make, field):
    error = refused(BadValue, "multiplied", make, Param("live", 1.0))
    assert field in str(error) and "Param('live', 1.0" in str(error)


@pytest.mark.parametrize("value", [np.nan, -np.inf])
@pytest.mark.parametrize(
    "make",
    [
        lambda q: constant(q),
        lambda q: Param("k", q),
        lambda q: blocks.velocity(x, q),
        lambda q: blocks.fir(x, [1, q]),
        lambda q: blocks.lut(x, [0, q], [1, 2]),
        lambda q: blocks.lut(x, [0, 1], [q, 2]),
        lambda q: blocks.delay(x, seconds=q),
    ],
)
def test_numbers_that_are_not_finite(make, value):
    refused(BadValue, "finite|rise|above 0", make, value)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: blocks.velocity(x, 0.0), "cutoff"),
        (lambda: blocks.first_order(x, 0.0), "tau"),
        (lambda: blocks.delay(x), "samples"),
        (lambda: blocks.delay(x, 3, 0.1), "seconds"),
        (lambda: blocks.delay(x, 0), "samples"),
        (lambda: blocks.delay(x, samples=1.5), "samples"),
        (lambda: blocks.delay(x, 0.01), "seconds=0.01"),
        (lambda: blocks.delay(x, seconds=-1), "seconds"),
        (lambda: blocks.fir(x, []), "taps"),
        (lambda: blocks.fir(x, [0, 0]), "taps"),
        (lambda: blocks.fir(x, 3.0), "taps"),
        (lambda: blocks.fir(x, [[1, 2]]), "taps"),
        (lambda: blocks.fir(x, ["a"]), "taps"),
        (lambda: blocks.lut(x, [0], [1]), "knots"),
        (lambda: blocks.lut(x, [0, 0], [1, 2]), "knots"),
        (lambda: blocks.lut(x, [0, 1], [1, 2, 3]), "values"),
        (lambda: blocks.lut(x, [0, 1], [1, 2], kind="quintic"), "quintic"),
        (lambda: blocks.lut(x, [0, 1], [1, 2], outside="wrap"), "wrap"),
        (lambda: blocks.lut(x, [0, 1], [1, 2], kind="k" * 201), "201 letters"),
        (lambda: carrier(-1.0), "0 or above"),
        (lambda: "x" + x, "a number"),
        (lambda: blocks.loading(v, 0.1, 0.2), "off"),
        (lambda: blocks.loading(v, 0.1), "off"),
        (lambda: blocks.loading(v, 0.1, 0.0), "off"),
        (lambda: blocks.loading(v), "on"),
        (lambda: blocks.loading(blocks.velocity(x), resolution=0.0), "resolution"),
        (lambda: blocks.white_noise(-1), "seed"),
        (lambda: blocks.white_noise(2**64), "seed"),
        (lambda: blocks.white_noise(1.5), "seed"),
        (lambda: blocks.white_noise(True), "seed"),
        (lambda: blocks.white_noise(1, 2**32), "stream"),
        (lambda: blocks.pink_noise(0.0, 1), "psd_1hz"),
        (lambda: blocks.pinking(x, -1.0), "f_low"),
        (lambda: blocks.pinking(x, 1.0, 0.0), "tol_db"),
        (lambda: blocks.differentiator(x, passband=-3.0), "passband"),
        (lambda: blocks.differentiator(x, order=0), "order"),
        (lambda: blocks.differentiator(x, tol=0.0), "tol"),
        (lambda: x + "1", "a number"),
        (lambda: x * None, "a number"),
        (lambda: Param("k", "N/m"), "value"),
        (lambda: Param("k", None), "value"),
        (lambda: constant("a"), "value"),
        (lambda: Input(3), "name"),
    ],
)
def test_values_that_make_no_sense_are_found_where_they_are_written(make, says):
    refused(BadValue, says, make)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: blocks.velocity(n, 500.0), ["cutoff", "500"]),
        (lambda: blocks.differentiator(n, 500.0), ["passband", "fs/2"]),
        (lambda: blocks.differentiator(n, 450.0), ["order=", "tol"]),
        (lambda: blocks.pinking(n, 400.0), ["f_low"]),
        (lambda: blocks.pinking(n, 1.0, 1e-12), ["tol_db"]),
        (lambda: blocks.delay(n, seconds=1e-5), ["half a sample"]),
    ],
)
def test_what_does_not_fit_the_sample_rate_is_found_when_compiling(make, words):
    scene = Scene({"y": make()})
    for target in ("llvm", "python"):
        error = refused(BadValue, None, stimlib.compile, scene, 1000, target)
        assert all(w in str(error) for w in words), error


ENOUGH = [  # a block of a number that is refused, how the error names one that is not
    (lambda v: blocks.differentiator(n, 100.0, order=v), r"use order=(\d+)", 8, 1000),
    (lambda v: blocks.differentiator(n, 1000.0, order=64, tol=v), r"or tol=(\S+)", 1e-6, 8000),
    (lambda v: blocks.pinking(n, 0.1, v), r"which reach (\S+) dB", 1e-8, 48000),
    (
        lambda v: blocks.springpot(n, 1.0, 0.5, "gl-downsampled", horizon=v),
        r"at most (\S+)",
        500.0,
        44100,
    ),
    (
        lambda v: blocks.friction(x, 1.0, law="lugre", static=0.8, damping=1.0, viscosity=v),
        r"= (\S+) N s/m",
        0.0,
        1000,
    ),
    (lambda v: blocks.button(x, drop=1 / 3, back=v).force, r"drop at = (\S+) ", 0.0002, 1000),
]


@pytest.mark.parametrize(("make", "words", "first", "fs"), ENOUGH)
def test_the_number_an_error_names_is_enough(make, words, first, fs):
    def designed(v):
        return [block.design(fs) for block in reach([make(v)])]

    error = refused(BadValue, words, designed, first)
    designed(type(first)(re.search(words, str(error))[1]))


def test_filters_on_noise_longer_than_the_lead():
    noise = Scene({"y": blocks.delay(blocks.fir(blocks.white_noise(1), np.ones(200)), 60)})
    refused(SceneError, "259 samples.*256", stimlib.compile, noise, 8000, "python")
    stimlib.compile(noise, 16000, "python")
    stimlib.compile(Scene({"y": blocks.delay(n, 5000)}), 8000, "python")  # of an input: any length


def test_noise_keys():
    one, both = blocks.white_noise(1), blocks.white_noise(1, shared=True)
    pink = blocks.pink_noise(1.0, 1, 2)
    for outputs, says in (
        ({"y": blocks.white_noise(1, 2) + pink}, "seed=1, stream=2.*seed=2"),
        ({"y": one, "z": blocks.white_noise(1)}, "two noise sources"),
        ({"y": both + one}, "two noise sources"),
        ({"y": one + blocks.enabled(one, by=n)}, "two clocks"),
        ({"y": blocks.enabled(one, by=n) + blocks.enabled(one, by=-n)}, "two clocks"),
    ):
        refused(SceneError, says, Scene, outputs)
    shared = blocks.white_noise(1, 2, shared=True) + blocks.pink_noise(1.0, 1, 2, shared=True)
    gate = blocks.enabled(one, by=n) + blocks.enabled(one, by=n)  # one and the same gate
    for block in (shared, one + 2 * one, both + blocks.enabled(both, by=n), gate):
        Scene({"y": block, "z": block})


def test_names_used_twice():
    for block in (
        Input("a") + Param("a", 1.0),
        Input("a", "m") * Input("a", "s"),
        Param("a", 1.0) * Param("a", 2.0),
    ):
        refused(SceneError, "name 'a' is used", Scene, {"y": block})
    assert list(Scene({"y": Input("a") + Input("a")}).inputs) == ["a"]


@pytest.mark.parametrize("outputs", [{}, [x], x, {"": x}, {"a b": x}, {3: x}, {"y": None}])
def test_outputs_that_are_none(outputs):
    refused((SceneError, BadValue), "output|Scene|number", Scene, outputs)


# Classes ------------------------------------------------------------------------------
def test_final_and_abstract_classes_and_their_names():
    with pytest.raises(TypeError, match="Mul is final"):

        class More(Mul):
            pass

    @dataclass(frozen=True, eq=False)
    class Half(Block, abstract=True):
        x: Block

    @dataclass(frozen=True, eq=False)
    class Mine(Half):
        pass

    refused(TypeError, "abstract", Half, n)
    for name in ("More", "Map", f"{__name__}.{Half.__qualname__}"):
        assert name not in registry
    assert registry[f"{__name__}.{Mine.__qualname__}"] is Mine and registry["Mul"] is Mul
    assert repr(Mine(n)) == "Mine(Input('n'))"


@pytest.mark.parametrize(
    "made", [lambda cls: cls, dataclass, dataclass(frozen=True), dataclass(eq=False)]
)
def test_a_class_that_is_not_decorated_as_a_block_is(made):
    @made
    class Mine(Block):
        x: Block

    class Own(Block):
        def __init__(self, x):
            self.x = x

    refused(SceneError, r"^Mine: .*eq=False\), and write no __init__$", Mine, n)
    for use in (lambda b: Scene({"y": b}), lambda b: b + 1, lambda b: 2 * b):
        refused(SceneError, r"Own: .*eq=False\), and write no __init__$", use, Own(n))


# Text ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("block", "text"),
    [
        (x, "Input('x', 'm')"),
        (constant(2.0, "N/m"), "Const(2.0, 'N/m')"),
        (Param("k", 3.0, "N/m"), "Param('k', 3.0, 'N/m')"),
        (2 * x, "Mul(Const(2.0), Input('x'))"),
        (blocks.velocity(2 * x, 30.0), "Velocity("),
        (blocks.fir(x, [1, 2, 3]), "taps=[1.0, 2.0, 3.0]"),
        (blocks.enabled(blocks.white_noise(1), by=n > 0.5), "Enabled(White(..), Greater(..))"),
        (blocks.delay(x, 4), "samples=4"),
        (
            Scene({"force": Param("k", 2000.0, "N/m") * x, "speed": blocks.velocity(x)}),
            "Scene(x [m], k [N/m] -> force [N], speed [m/s])",
        ),
        (Scene({"y": 3.0}), "Scene(no input -> y [1])"),
    ],
)
def test_blocks_and_scenes_print_on_one_line(block, text):
    shown = repr(block)
    assert "\n" not in shown and len(shown) < 80
    assert text in shown.replace(", ''", "")


# Depth --------------------------------------------------------------------------------
def mixed_chain(length):
    """A signal through thousands of blocks, and the same with numpy."""
    kinds = (
        (lambda b: b + 0.25, lambda y: y + 0.25),
        (lambda b: 0.999 * b, lambda y: 0.999 * y),
        (lambda b: blocks.delay(b, samples=1), lambda y: np.r_[0.0, y[:-1]]),
        (lambda b: blocks.minimum(-b, 3.0), lambda y: np.where(-y > 3.0, 3.0, -y)),
        (lambda b: abs(b) - 0.125 * b, lambda y: abs(y) - 0.125 * y),
    )
    block, y = n, np.random.default_rng(0).standard_normal(40)
    for k in range(length):
        block, y = kinds[k % 5][0](block), kinds[k % 5][1](y)
    return block, y


def test_thousands_of_blocks(tmp_path):
    block, y = mixed_chain(1500)
    assert len(reach([block])) > 1500
    assert len(repr(block)) < 80
    scene = Scene({"y": block})
    assert "y [1]" in repr(scene)
    scene.save(tmp_path / "deep.json")
    again = stimlib.load(tmp_path / "deep.json")
    assert again.hash == scene.hash
    u = np.random.default_rng(0).standard_normal((1, 40))
    for target, size in (("llvm", 40), ("python", 3)):
        proc = stimlib.compile(again, 1000, target)
        np.testing.assert_array_equal(proc.process(u[:, :size].copy())[0], y[:size])
    assert len(str(proc.plan).splitlines()) > 1500
    assert proc.latency["y", "n"] == (300, 300)


def test_a_wide_diamond_is_not_walked_twice():
    block = n
    for _ in range(200):
        block = block + block * 0.5
    proc = stimlib.compile(Scene({"y": block}), 1000)
    assert len(proc.program.instances) < 500
    np.testing.assert_allclose(proc.process(np.ones((1, 1))), 1.5**200, rtol=1e-13)
