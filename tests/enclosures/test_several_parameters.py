"""Proofs over three parameters and more, and the arithmetic of Taylor models, against mpmath in 40 digits."""

import casadi as ca
import loop_proofs
import mpmath
import numpy as np
import pytest

from symmb.enclosures import taylor_models as tm

ONE = {
    "OP_NEG": lambda a: -a, "OP_SQ": lambda a: a * a, "OP_TWICE": lambda a: 2 * a, "OP_INV": lambda a: 1 / a,
    **{f"OP_{name.upper()}": getattr(mpmath, name) for name in (
        "sqrt", "sin", "cos", "tan", "exp", "sinh", "cosh", "expm1", "log", "atan", "tanh", "asin", "erf")},
}  # fmt: skip
TWO = {
    "OP_ADD": lambda a, b: a + b, "OP_SUB": lambda a, b: a - b, "OP_MUL": lambda a, b: a * b,
    "OP_DIV": lambda a, b: a / b, "OP_HYPOT": lambda a, b: mpmath.sqrt(a * a + b * b),
}  # fmt: skip
PLACES = 2


def _random_model(basis, is_complex, rng):
    """A model about 1, whose terms fall or not."""
    terms, size = basis.counts[int(rng.integers(0, basis.degree + 1))], 10.0 ** rng.uniform(-3, -0.7)
    c = size * rng.normal(size=(terms, PLACES)) / terms
    if is_complex:
        c = c + 1j * size * rng.normal(size=c.shape) / terms
    c[0] = rng.uniform(0.4, 0.9, PLACES) + (0.2j * rng.normal(size=PLACES) if is_complex else 0)
    return tm.Model(c, np.full(PLACES, rng.choice([0.0, 10.0 ** rng.uniform(-8, -2)])), basis)


def _value(model, x, place):
    """The polynomial at a point, in 40 digits."""
    total = mpmath.mpc(0)
    for c, exponents in zip(np.broadcast_to(model.c, (len(model.c), PLACES)), model.basis.exponents, strict=False):
        term = mpmath.mpc(complex(c[place]))
        for one, power in zip(x, exponents, strict=True):
            term *= mpmath.mpf(float(one)) ** int(power)
        total += term
    return total


def _farthest(name, exact, arity, trials=12):
    """Largest distance of exact values from a result, over its radius."""
    rng, worst = np.random.default_rng(7), 0.0
    with mpmath.workdps(40):
        for trial in range(trials):
            basis, is_complex = tm.basis_of(int(rng.integers(1, 4)), int(rng.integers(1, 5))), trial % 2 == 0
            arguments = [_random_model(basis, is_complex, rng) for _ in range(arity)]
            found = tm.OPERATIONS[getattr(ca, name)](*arguments)
            for _ in range(3):
                x = rng.choice([-1.0, 1.0], basis.variables) * rng.choice([1.0, rng.random()], basis.variables)
                place, values = int(rng.integers(PLACES)), []
                for a in arguments:
                    turn = np.exp(2j * np.pi * rng.random()) if is_complex else rng.choice([-1.0, 1.0])
                    z = _value(a, x, place) + mpmath.mpc(complex(0.999999 * turn * a.radius[place]))
                    values.append(z if is_complex else mpmath.re(z))
                radius = float(np.broadcast_to(found.radius, PLACES)[place])
                off = abs(exact(*values) - _value(found, x, place))
                worst = max(worst, float(off / mpmath.mpf(max(radius, 1e-290))))
    return worst


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_models_hold_all_values_of_their_arguments(name):
    exact, arity = (ONE[name], 1) if name in ONE else (TWO[name], 2)
    assert _farthest(name, exact, arity) <= 1.0


@pytest.mark.parametrize("exponent", [2.0, 5.0, -1.0, -3.0, 0.5, 1.5])
def test_constant_powers(monkeypatch, exponent):
    power = tm.OPERATIONS[ca.OP_POW]
    monkeypatch.setitem(tm.OPERATIONS, ca.OP_POW, lambda a: power(a, a.basis.constant(exponent)))
    assert 0.0 < _farthest("OP_POW", lambda a: a**exponent, 1) <= 1.0


@pytest.mark.parametrize("name", ["OP_INV", "OP_SQRT", "OP_EXP", "OP_LOG"])
def test_models_at_extreme_scales(name):
    """Coefficients and values that underflow, and wide ranges about them."""
    rng, finite = np.random.default_rng(8), 0
    with mpmath.workdps(700), np.errstate(all="ignore"):
        for trial in range(60):
            basis = tm.basis_of(1, trial % 6)
            size = rng.uniform(-1500, 0) if name == "OP_EXP" else 10.0 ** rng.uniform(-200, 200)
            spread = abs(size) * rng.choice([1e-9, 0.5, 0.9])
            radius = 0.0 if basis.degree else spread
            c = np.array([[size], [spread]]) if basis.degree else np.array([[size]])
            found = tm.OPERATIONS[getattr(ca, name)](tm.Model(c, np.full(1, radius), basis))
            finite += bool(np.isfinite(found.radius).all())
            for x in (-1.0, 1.0):
                exact = ONE[name](mpmath.mpf(size) + mpmath.mpf(x) * mpmath.mpf(spread))
                here = sum(mpmath.mpf(float(one[0])) * mpmath.mpf(x) ** k for k, one in enumerate(found.c))
                assert not np.isfinite(found.radius[0]) or abs(exact - here) <= float(found.radius[0]), (size, spread)
    assert finite > 20


def test_terms_that_are_cut_and_forgotten_are_found(monkeypatch):
    """Without the terms beyond the degree, values are outside."""
    monkeypatch.setattr(tm, "_lost", lambda a, b, most: 0.0)
    assert _farthest("OP_MUL", TWO["OP_MUL"], 2) > 1.0


def test_a_model_that_may_vanish_has_no_inverse():
    basis = tm.basis_of(2, 3)
    c = np.zeros((3, 1))
    c[0], c[1], c[2] = 1.0, 0.6, 0.5
    assert np.isinf(tm.OPERATIONS[ca.OP_INV](tm.Model(c, np.zeros(1), basis)).radius).all()
    c[2] = 0.3
    assert np.isfinite(tm.OPERATIONS[ca.OP_INV](tm.Model(c, np.zeros(1), basis)).radius).all()


def test_coefficients_of_chebyshev_polynomials():
    basis, rng = tm.basis_of(3, 6), np.random.default_rng(0)
    c, x = rng.normal(size=len(basis.exponents)), rng.uniform(-1, 1, (50, 3))
    powers = np.prod(x[:, None] ** basis.exponents, axis=2)
    waves = np.prod(np.cos(basis.exponents * np.arccos(x)[:, None]), axis=2)
    np.testing.assert_allclose(waves @ (basis.to_chebyshev @ c), powers @ c, rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", [*(pytest.param(seed, marks=pytest.mark.long) for seed in (500, 503, 506)), 511])
def test_random_mechanisms_against_closed_forms(seed):
    """Three to five uncertain parameters."""
    found = loop_proofs.check(loop_proofs.random_case(seed, several=True), order=3, count=4)
    told = f"{found.kind}: outside by {found.outside:.1e}, {found.proved:.0%} proved, {found.fault} {found.refused}"
    assert found.outside <= loop_proofs.INSIDE and not found.fault, told
    assert found.proved == 1.0 and found.ratio < 1.01, told
