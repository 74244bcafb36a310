"""Every block of the table beyond the rates and sizes that it was made for: run below
1 kHz and above 192 kHz, on inputs down to 1e-300, and up to 1e90 where it is linear,
against its reference law; and what scales, scales exactly.

A draw of them; in ``make stress`` all.
"""

import re
from functools import cache

import numpy as np
import pytest
from contract import TABLE
from hypothesis import given, settings, strategies as st
from laws import rows, run

import stimlib
from stimlib.checks import local
from stimlib.errors import StimlibError

RATES = 8.0, 100.0, 384e3, 1e6
POWERS = -300, 100, 333, 600, 665, 997  # of 1/2: 1e90, 1e-30, 1e-100, 1e-180, 1e-200, 1e-300
EXACT = 600  # until here second words, 2^-106 of a state, are far above maths.TINY
N = 260
DRIVEN = [e for e in TABLE if e.inputs]


@cache
def built(entry, fs):
    """The processor, or why there is none: the argument or the rate that was given."""
    try:
        return stimlib.compile(entry.scene(), fs)
    except StimlibError as e:
        assert fs not in entry.rates
        assert re.match("[a-z_ ]+: ", str(e)) and re.search(r"fs|lower|horizon", str(e)), e
        return None


def scaled(entry, fs, power):
    """Samples of inputs times 2^-power, which must be those of the laws."""
    proc, x = built(entry, fs), np.ldexp(entry.x(N, fs, 5), -power)
    params = {name: p.value for name, p in proc.scene.params.items()}
    given_rows = dict(zip(entry.inputs, x, strict=True))
    found = local.held(local.Run(entry.scene().outputs, fs, 0, given_rows, N, params, [], [(0, N)]))
    far = {h.kind: h.error for h in found if not h.error <= 1}
    assert not far, f"{entry.name} at {fs:g} Hz, inputs times 2^{-power}, in tolerances: {far}"
    proc.reset()
    y = run(proc, rows(proc, x, entry.inputs))
    assert proc.fault is None
    return y


@cache
def usual(entry, fs):
    """Samples of the usual inputs; and whether they scale, as those of 2^-40 do."""
    y = scaled(entry, fs, 0)
    return y, entry.lti or y.any() and np.array_equal(scaled(entry, fs, 40), np.ldexp(y, -40))


def assert_lawful(entry, fs, power):
    if built(entry, fs) is None or (power < 0 and not entry.lti):  # exp(1e90) is inf
        return
    y, scales = usual(entry, fs)
    small = scaled(entry, fs, power)
    if scales:
        limit = 0.0 if power <= EXACT else local.FADED
        np.testing.assert_allclose(small, np.ldexp(y, -power), rtol=0, atol=limit)


@given(st.sampled_from(TABLE), st.sampled_from(RATES))
@settings(max_examples=15)
def test_every_block_runs_at_every_rate(entry, fs):
    assert_lawful(entry, fs, 0)


@given(st.sampled_from(DRIVEN), st.sampled_from((None, *RATES)), st.integers(-300, 997))
@settings(max_examples=25)
def test_small_and_large_inputs(entry, fs, power):
    assert_lawful(entry, fs or entry.rates[0], power)


@pytest.mark.stress
@pytest.mark.parametrize("entry", [pytest.param(e, id=e.name) for e in TABLE])
def test_the_whole_table(entry):
    for fs in (entry.rates[0], *RATES):
        for power in POWERS if entry.inputs else (0,):
            assert_lawful(entry, fs, power)
