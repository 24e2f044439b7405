"""Proofs over three parameters and more, and the arithmetic of Taylor models, against mpmath in 40 digits."""

import casadi as ca
import drag_proofs
import mpmath
import numpy as np
import pytest
from black_boxes import quietly
from enclosure_samples import EXACT
from machines import rods

import symmb as mb
from symmb.prove import taylor_models as tm
from symmb.prove import terms
from symmb.prove.basis import basis_of

ONE = "NEG SQ TWICE INV SQRT SIN COS TAN EXP SINH COSH EXPM1 LOG ATAN TANH ASIN ERF"
TWO = "ADD SUB MUL DIV HYPOT"
ARITY = {f"OP_{name}": arity for arity, names in ((1, ONE), (2, TWO)) for name in names.split()}
EXACT = EXACT | {"OP_HYPOT": lambda a, b: mpmath.sqrt(a * a + b * b)}  # of complex numbers as well
PLACES = 2


def _random_model(basis, is_complex, rng):
    """A model about 1, whose terms fall or not."""
    terms, size = basis.counts[int(rng.integers(0, basis.degree + 1))], 10.0 ** rng.uniform(-3, -0.7)
    c = size * rng.normal(size=(terms, PLACES)) / terms
    if is_complex:
        c = c + 1j * size * rng.normal(size=c.shape) / terms
    c[0] = rng.uniform(0.4, 0.9, PLACES) + (0.2j * rng.normal(size=PLACES) if is_complex else 0)
    return tm.Model(c, np.full(PLACES, rng.choice([0.0, 10.0 ** rng.uniform(-8, -2)])), basis)


def _value(model, x, place=0):
    """The polynomial of a place, or of all places, at a point, in 40 digits."""
    terms = zip(model.c[:, place % model.c.shape[1]], model.basis.exponents, strict=False)
    powers = ((c, [mpmath.mpf(float(one)) ** int(k) for one, k in zip(x, own, strict=True)]) for c, own in terms)
    return sum((mpmath.mpc(complex(c)) * mpmath.fprod(parts) for c, parts in powers), mpmath.mpc(0))


def _farthest(name, exact, arity, trials=12):
    """Largest distance of exact values from a result, over its radius."""
    rng, worst = np.random.default_rng(7), 0.0
    with mpmath.workdps(40):
        for trial in range(trials):
            basis, is_complex = basis_of((1,) * int(rng.integers(1, 4)), int(rng.integers(1, 5))), trial % 2 == 0
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


@pytest.mark.parametrize("name", ARITY)
def test_models_hold_all_values_of_their_arguments(name):
    assert _farthest(name, EXACT[name], ARITY[name]) <= 1.0


@pytest.mark.parametrize("exponent", [2.0, 5.0, -1.0, -3.0, 0.5, 1.5])
def test_constant_powers(monkeypatch, exponent):
    power = tm.OPERATIONS[ca.OP_POW]
    monkeypatch.setitem(tm.OPERATIONS, ca.OP_POW, lambda a: power(a, tm.constant(a.basis, exponent)))
    assert 0.0 < _farthest("OP_POW", lambda a: a**exponent, 1) <= 1.0


@pytest.mark.parametrize("name", ["OP_INV", "OP_SQRT", "OP_EXP", "OP_LOG"])
def test_models_at_extreme_scales(name):
    """Coefficients and values that underflow, and wide ranges about them."""
    rng, finite = np.random.default_rng(8), 0
    with mpmath.workdps(700), np.errstate(all="ignore"):
        for trial in range(60):
            basis = basis_of((1,) * 1, trial % 6)
            size = rng.uniform(-1500, 0) if name == "OP_EXP" else 10.0 ** rng.uniform(-200, 200)
            spread = abs(size) * rng.choice([1e-9, 0.5, 0.9])
            radius = 0.0 if basis.degree else spread
            c = np.array([[size], [spread]]) if basis.degree else np.array([[size]])
            found = tm.OPERATIONS[getattr(ca, name)](tm.Model(c, np.full(1, radius), basis))
            finite += bool(np.isfinite(found.radius).all())
            for x in (-1.0, 1.0):
                exact = EXACT[name](mpmath.mpf(size) + mpmath.mpf(x) * mpmath.mpf(spread))
                here = sum(mpmath.mpf(float(one[0])) * mpmath.mpf(x) ** k for k, one in enumerate(found.c))
                assert not np.isfinite(found.radius[0]) or abs(exact - here) <= float(found.radius[0]), (size, spread)
    assert finite > 20


def test_terms_that_are_cut_and_forgotten_are_found(monkeypatch):
    """Without the terms beyond the degree, values are outside."""
    monkeypatch.setattr(tm, "_lost", lambda a, b, most: 0.0)
    assert _farthest("OP_MUL", EXACT["OP_MUL"], 2) > 1.0


def test_a_model_that_may_vanish_has_no_inverse():
    basis = basis_of((1,) * 2, 3)
    c = np.zeros((3, 1))
    c[0], c[1], c[2] = 1.0, 0.6, 0.5
    assert np.isinf(tm.OPERATIONS[ca.OP_INV](tm.Model(c, np.zeros(1), basis)).radius).all()
    c[2] = 0.3
    assert np.isfinite(tm.OPERATIONS[ca.OP_INV](tm.Model(c, np.zeros(1), basis)).radius).all()


@pytest.mark.parametrize("name", ["OP_SQRT", "OP_INV"])
@pytest.mark.parametrize("is_complex", [False, True])
def test_squares_that_come_close_to_zero(name, is_complex):
    """w^2 + e^2 where w is in [-1.5 e, 1.5 e], about 0 or not: series about its value in the middle have no end."""
    rng, finite = np.random.default_rng(11), 0
    with mpmath.workdps(40):
        for trial in range(12):
            basis, e = basis_of((1,) * 3, 2 + trial % 5), 10.0 ** rng.uniform(-3, 3)
            c = e * rng.dirichlet(np.ones(4))[:, None] * rng.choice([-1.5, 1.0], (4, 1))
            c = c * np.exp(0.1j * rng.normal()) if is_complex else c
            square = tm.OPERATIONS[ca.OP_SQ](tm.Model(c, np.zeros(1), basis))
            found = tm.OPERATIONS[getattr(ca, name)](tm.OPERATIONS[ca.OP_ADD](square, tm.constant(basis, e**2)))
            finite += bool(np.isfinite(found.radius).all())
            for _ in range(6):
                x = rng.choice([-1.0, 1.0], 3) * rng.choice([1.0, rng.random()], 3)
                terms = (mpmath.mpc(complex(a)) * b for a, b in zip(c[1:, 0], (basis.exponents[1:4] @ x), strict=True))
                own = sum(terms, mpmath.mpc(complex(c[0, 0])))
                off = abs(EXACT[name](own**2 + mpmath.mpf(e) ** 2) - _value(found, x))
                assert off <= mpmath.mpf(float(found.radius[0]))
    assert finite >= 8


@pytest.mark.parametrize("seed", [600, 601, 602, 603, 604])
def test_drag_that_passes_a_speed_of_zero(seed):
    """Rounded and with kinks, along one axis and along the speed, by three uncertain parameters."""
    off, proved, doubts = drag_proofs.judged(drag_proofs.scene_of(seed)[1], 64, seed)
    assert off <= drag_proofs.INSIDE
    assert (proved == 1.0).all(), doubts


def drag(law, spread):
    """A pendulum that turns back at 0.2 s, against a drag that is a law of its speed."""
    damper = lambda m: mb.Actuator("damper", m.hinge0, -m.p.c * law(m.hinge0.angle_rate))  # noqa: E731
    machine = rods(1, damper, c=0.1, w0=2.0)
    p, box = machine.p, mb.Box.around(machine.p, spread, ["length", "c", "w0"])
    start = {"hinge0.angle": np.pi / 2 - 1.0, "hinge0.angle_rate": p.w0}
    outputs = {"angle": machine.hinge0.angle, "off": ca.fabs(p.w0 - 2.0), "late": ca.fabs(mb.t - 0.3)}
    scene = machine.scene(outputs, np.linspace(0, 0.5, 11), start, box=box)
    return quietly(mb.propagate, scene, mb.TaylorModel(order=8))


@pytest.mark.parametrize(
    ("law", "is_proved", "cause"),
    [
        (lambda w: w * ca.sqrt(w**2 + 0.01), True, "infinite for off"),
        (
            lambda w: w * ca.fabs(w) ** 0.5,
            False,
            "'hinge0.angle_rate' becomes 0. A law may have infinite derivatives at 0",
        ),
        (lambda w: w * ca.sqrt(w**2 + 1e-6), False, "has no bound over the box"),
    ],
)
def test_drag_that_ends_a_proof_and_outputs_with_kinks_are_named(law, is_proved, cause):
    """Beside rounded quadratic drag, the kinks of |w0 - 2| and |t - 0.3| leave the angle proved."""
    bounds = drag(law, 0.02)
    assert np.isfinite(bounds.upper[:3, 0]).all() and np.isinf(bounds.upper[-1, 0]) != is_proved
    assert np.isfinite(bounds.upper[:, 0]).all() == is_proved and cause in " ".join(bounds.doubts)


@pytest.mark.parametrize(("weights", "degree"), [((1, 1, 1), 6), ((1, 1, 1, 1), 5), ((1, 2, 2, 3, 1), 6)])
def test_products_of_the_next_degree_do_not_change_a_fit(weights, degree):
    """Products of the basis are fitted exactly. Those of one degree more give 0, others one coefficient at most."""
    basis, more = basis_of(weights, degree), basis_of(weights, degree + 3)
    found = np.abs(terms._fit(basis) @ terms._values(more, basis))
    size = len(basis.exponents)
    np.testing.assert_allclose(found[:, :size], np.eye(size), rtol=0, atol=1e-13)
    np.testing.assert_allclose(found[:, more.degrees == degree + 1], 0.0, rtol=0, atol=1e-13)
    assert found[:, size:].sum(axis=0).max() < 1 + 1e-12


def test_coefficients_of_chebyshev_polynomials():
    basis, rng = basis_of((1,) * 3, 6), np.random.default_rng(0)
    c, x = rng.normal(size=len(basis.exponents)), rng.uniform(-1, 1, (50, 3))
    powers = np.prod(x[:, None] ** basis.exponents, axis=2)
    waves = np.prod(np.cos(basis.exponents * np.arccos(x)[:, None]), axis=2)
    np.testing.assert_allclose(waves @ (basis.to_chebyshev @ c), powers @ c, rtol=0, atol=1e-13)
