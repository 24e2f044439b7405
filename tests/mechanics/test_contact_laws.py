"""Laws of contact: their formulas, no pull, and derivatives that stay finite at and beyond touch, however evaluated."""

import casadi as ca
import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose, assert_array_equal

import symmb as mb
from symmb.declare.symbolic.jets import jets
from symmb.run.codegen import Engine, Lanes, StepTolerances, model_function

K, E, V = 1e8, 0.7, 2.0
RING = mb.Table([0.0, 1e-3, 3e-3], [0.0, 4e4, 9e5])
LAWS = {
    "HuntCrossley": (mb.HuntCrossley(K, E, V), 3 * (1 - E) / (2 * V)),
    "LankaraniNikravesh": (mb.LankaraniNikravesh(K, E, V), 3 * (1 - E**2) / (4 * V)),
    "Flores": (mb.Flores(K, E, V), 8 * (1 - E) / (5 * E * V)),
    "HuntCrossley, other exponent": (mb.HuntCrossley(K, E, V, exponent=2.2), 3 * (1 - E) / (2 * V)),
    "HuntCrossley, linear": (mb.HuntCrossley(K, E, V, exponent=1), 3 * (1 - E) / (2 * V)),
    "spring": (mb.HuntCrossley(K, 1.0, V), 0.0),
}
EVERY = {name: law for name, (law, _) in LAWS.items()} | {
    "KelvinVoigt": mb.KelvinVoigt(1e6, 210.0),
    "Tabulated": mb.Tabulated(RING, 150.0),
}
D, RATE = ca.SX.sym("d"), ca.SX.sym("rate")
DEPTHS = (-1.0, -1e-3, -1e-300, -0.0, 0.0, 5e-324, 1e-13, 1e-11, 1e-9, 1e-4, 2e-3)
STATES = np.array([(d, rate) for d in DEPTHS for rate in (-9.0, -0.5, 0.0, 0.5, 9.0)])
every = pytest.mark.parametrize("law", EVERY.values(), ids=EVERY)


def evaluated(expression):
    return ca.Function("f", [D, RATE], [expression])(*STATES.T[:, None, :]).full().T


@pytest.mark.parametrize("name", [*LAWS, "KelvinVoigt"])
def test_a_force_is_that_of_its_formula_and_pushes_only(name):
    law, (d, rate) = EVERY[name], STATES.T
    expected = np.where(d > 0, np.maximum(1e6 * d + 210 * rate, 0), 0)
    if name in LAWS:
        d, chi = np.maximum(d, 0), LAWS[name][1]
        expected = np.where(d > 1e-12, K * d ** float(law.exponent) * np.maximum(1 + chi * rate, 0), 0)
    assert_allclose(evaluated(law.force(D, RATE))[:, 0], expected, rtol=1e-14)


def test_a_tabulated_force_pushes_only():
    values = evaluated(EVERY["Tabulated"].force(D, RATE))[:, 0]
    at = dict(zip(map(tuple, STATES.tolist()), values.tolist(), strict=True))
    assert at[2e-3, 0.5] == pytest.approx(float(RING(2e-3)) + 75)
    assert at[2e-3, -9.0] == pytest.approx(float(RING(2e-3)) - 1350)
    assert at[1e-4, -0.5] == pytest.approx(float(RING(1e-4)) - 75)
    assert at[1e-9, -9.0] == at[-1e-3, 9.0] == 0


@every
def test_forces_and_derivatives_are_finite_and_vanish_before_touch(law):
    expression, apart = law.force(D, RATE), STATES[:, 0] <= 0
    for order in range(4):
        values = evaluated(expression)
        assert np.isfinite(values).all(), order
        assert_array_equal(values[apart], 0)
        assert np.abs(values[STATES[:, 0] == 2e-3]).max() > 0 or order > 1
        expression = ca.vec(ca.jacobian(expression, ca.vertcat(D, RATE)))


@every
def test_taylor_coefficients_are_finite_and_those_of_differences(law):
    curve = [[ca.SX.sym(f"{name}{k}") for k in range(4)] for name in ("d", "rate")]
    coefficients = ca.vertcat(*jets(law.force(curve[0][0], curve[1][0]), curve))
    f = ca.Function("jets", [ca.vertcat(*curve[0], *curve[1])], [coefficients])
    rng = np.random.default_rng(1)
    for state in STATES:
        assert np.isfinite(f([state[0], *rng.uniform(-1, 1, 3), state[1], *rng.uniform(-1, 1, 3)]).full()).all()
    d, rate, h = np.array([1.1e-3, 0.2, -0.3, 0.5]), np.array([0.4, -0.6, 0.2, 0.1]), 1e-5
    force = ca.Function("force", [D, RATE], [law.force(D, RATE)])
    at = [float(force(np.polyval(d[::-1], k * h), np.polyval(rate[::-1], k * h))) for k in (-2, -1, 0, 1, 2)]
    slope = (at[0] - 8 * at[1] + 8 * at[3] - at[4]) / 12
    curvature = (-at[0] + 16 * at[1] - 30 * at[2] + 16 * at[3] - at[4]) / 12
    expected = [at[2], slope / h, curvature / (2 * h**2)]
    assert_allclose(f([*d, *rate]).full()[:3, 0], expected, rtol=1e-4)


@every
def test_compiled_lanes_agree_with_casadi(law):
    x, p, t = ca.SX.sym("x", 2), ca.SX.sym("p"), ca.SX.sym("t")
    parts = [law.force(x[0], x[1])]
    for _ in range(3):
        parts.append(ca.vec(ca.jacobian(parts[-1], x)))
    outputs = ca.densify(ca.vertcat(*parts))
    f = model_function(x, p, t, ca.SX.zeros(2), outputs, None)
    engine = Engine(Lanes(f, StepTolerances(1e-8, 1e-8)), np.array([0.0]))
    Y, losses = engine.values(STATES, np.ones((len(STATES), 1)))
    assert np.isnan(losses.t_failed).all()
    expected = ca.Function("f", [x], [outputs])(STATES.T).full().T
    assert_allclose(Y[:, 0], expected, rtol=1e-13, atol=1e-300)


@pytest.mark.parametrize(
    ("law", "text"),
    [
        (lambda: mb.HuntCrossley(-1.0, 0.5, 1.0), r"HuntCrossley: stiffness is -1; it must be above 0\."),
        (lambda: mb.Flores(1.0, 1.5, 1.0), "Flores: restitution is 1.5; it must be above 0 and at most 1"),
        (lambda: mb.Flores(1.0, 0.0, 1.0), "Flores: restitution is 0; it must be above 0"),
        (lambda: mb.LankaraniNikravesh(1.0, 0.5, 0.0), "LankaraniNikravesh: speed is 0; it must be above 0"),
        (lambda: mb.HuntCrossley(1.0, 0.5, 1.0, exponent=0.5), "exponent is 0.5; it must be at least 1"),
        (lambda: mb.KelvinVoigt(1.0, -2.0), "KelvinVoigt: damping is -2; it must be at least 0"),
        (lambda: mb.KelvinVoigt(float("nan")), "KelvinVoigt: stiffness is nan"),
        (lambda: mb.Tabulated(RING, -1.0), "Tabulated: damping is -1"),
        (lambda: mb.Coulomb(0.3, 1e-3, static=0.2), "Coulomb: static is 0.2; it must be at least 0.3"),
        (lambda: mb.Coulomb(0.3, 0.0), "Coulomb: speed is 0; it must be above 0"),
        (lambda: mb.Bristle(0.3, 0.0), "Bristle: stiffness is 0; it must be above 0"),
        (lambda: mb.Bristle(0.0, 1e5), "Bristle: kinetic is 0; it must be above 0"),
    ],
)
def test_numbers_out_of_range_are_refused(law, text):
    refused(text, law)


@every
@pytest.mark.parametrize("number", [np.longdouble("2e-3"), np.float32(2e-3), np.array(2e-3)])
def test_a_law_takes_every_kind_of_number(law, number):
    assert_allclose(float(law.force(number, np.longdouble(0.5))), float(law.force(ca.SX(float(number)), ca.SX(0.5))))


@every
def test_a_law_refuses_what_is_no_number(law):
    refused("expected one number", law.force, "deep", RATE)
