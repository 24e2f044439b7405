"""The C that is written builds and runs on its own and gives the trajectory SciPy gives."""

import subprocess

import casadi as ca
import numpy as np
import pytest
from faults import refused
from processes import printed_lines
from scipy.integrate import solve_ivp

from symmb.equations.model.c_export import example_c, save_c

# A driven, damped pendulum beside a clock: q = (theta, c), c' = 1 with a velocity that never changes.
Q, V, S, P, T = (ca.SX.sym(name, n) for name, n in [("q", 2), ("v", 2), ("s", 1), ("p", 3), ("t", 1)])
LENGTH, DAMPING, DRIVE = ca.vertsplit(P)
PARAMETERS = {"l": 0.8, "c": 0.1, "amplitude": 2.0}
Q0, V0, S0 = [1.2, 0.0], [-0.3, 1.0], [0.2]


def _accelerations(torque):
    vdot = ca.SX(2, 1)
    vdot[0] = -9.81 / LENGTH * ca.sin(Q[0]) - DAMPING * V[0] + torque
    return vdot


PLAIN = ca.Function("rhs", [Q, V, P, T], [V, _accelerations(DRIVE * ca.cos(2 * T))], list("qvpt"), ["qdot", "vdot"])
RATES = [V, _accelerations(DRIVE * S), 3 * (ca.cos(2 * T) - S)]
FILTERED = ca.Function("rhs", [Q, V, S, P, T], RATES, list("qvspt"), ["qdot", "vdot", "sdot"])


def _pendulum(t, x):
    """Driven by the cosine, or by the fifth state, which follows it."""
    length, damping, amplitude = PARAMETERS.values()
    torque = amplitude * (x[4] if len(x) > 4 else np.cos(2 * t))
    rates = [x[2], x[3], -9.81 / length * np.sin(x[0]) - damping * x[2] + torque, 0.0]
    return [*rates, *(3 * (np.cos(2 * t) - x[4:]))]


@pytest.mark.parametrize("rhs, s", [(PLAIN, []), (FILTERED, S0)])
def test_example_builds_alone_and_agrees_with_scipy(tmp_path, rhs, s):
    t0, t1, steps = 0.5, 5.5, 2000
    names = ["rod.theta", "clock.x"]
    text = example_c(rhs, q=Q0, v=V0, s=s, parameters=PARAMETERS, coordinates=names, t0=t0, t1=t1, steps=steps)
    # gamma as a bare C name would clash with the function of math.h
    save_c({"rhs": rhs, "gamma": PLAIN, "M": ca.Function("M", [P], [ca.diag(P)])}, tmp_path / "c", example=text)
    head, *rows = printed_lines(tmp_path / "c")
    table = np.array([line.split() for line in rows], dtype=float)
    assert head.split() == ["t", "rod.theta", "clock.x"]
    np.testing.assert_allclose(table[:, 0], np.linspace(t0, t1, steps + 1), rtol=1e-14)
    expected = solve_ivp(_pendulum, (t0, t1), [*Q0, *V0, *s], "DOP853", table[:, 0], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(table[:, 1:], expected.y[:2].T, atol=1e-8)


@pytest.mark.parametrize(
    "rate, steps",
    [(Q[0] ** 3, 4000), (ca.sqrt(0.5 - Q[0]), 7), (ca.exp(Q[0]), 30)],
    ids=["runs away", "root", "exponential"],
)
def test_a_motion_that_breaks_down_ends_the_example_with_a_sentence(tmp_path, rate, steps):
    rhs = ca.Function("rhs", [Q, V, P, T], [ca.vertcat(rate, 0), ca.SX(2, 1)], list("qvpt"), ["qdot", "vdot"])
    options = {"q": [0.4, 0], "v": [0, 0], "parameters": PARAMETERS, "coordinates": ["x", "y"], "t0": 0.0, "t1": 400.0}
    save_c({"rhs": rhs}, tmp_path / "c", example=example_c(rhs, **options, steps=steps))
    with pytest.raises(subprocess.CalledProcessError) as error:
        printed_lines(tmp_path / "c")
    assert error.value.returncode == 1 and "nan" not in error.value.stdout
    assert error.value.stderr.startswith("The state became infinite or NaN in the step from t = ")


def test_functions_without_example_are_linked_by_a_program_of_ones_own(tmp_path):
    jacobian = ca.SX(2, 3)
    jacobian[0, 0], jacobian[1, 2] = ca.cos(P[0]), P[1] * P[2]
    save_c({"Phi_q": ca.Function("f", [P], [jacobian], ["p"], ["Phi_q"])}, tmp_path, name="crane")
    (tmp_path / "own.c").write_text(
        '#include <stdio.h>\n#include "crane.h"\n#include "crane.h"\n'
        "int main(void) { const double p[] = {0.5, 2, 3}, *arg[] = {p}; double y[2], *res[] = {y};\n"
        'crane_Phi_q(arg, res, 0, 0, 0); printf("%.17g %.17g", y[0], y[1]); return 0; }\n'
    )
    assert [float(word) for word in printed_lines(tmp_path)[0].split()] == pytest.approx([np.cos(0.5), 6])
    header = (tmp_path / "crane.h").read_text()
    assert "crane_Phi_q(p) -> (Phi_q)" in header
    assert "res[0]  Phi_q    2 x 3, stored: (0,0) (1,2)\n" in header
    assert "arg[0]  p        3 x 1\n" in header


def test_a_model_of_mx_with_an_inner_function(tmp_path):
    q, v, p, t = ca.MX.sym("q"), ca.MX.sym("v"), ca.MX.sym("p", 0), ca.MX.sym("t")
    inner = ca.Function("inner", [Q[0]], [ca.sin(Q[0])], {"never_inline": True})
    rhs = ca.Function("rhs", [q, v, p, t], [v, -inner(q)])
    text = example_c(rhs, q=[0.1], v=[0], parameters={}, coordinates=["x"], t0=0, t1=1, steps=100, name="mx")
    save_c({"rhs": rhs}, tmp_path, name="mx", example=text)
    end = float(printed_lines(tmp_path)[-1].split()[1])
    exact = solve_ivp(lambda _, x: [x[1], -np.sin(x[0])], (0, 1), [0.1, 0], "DOP853", rtol=1e-12, atol=1e-13)
    assert end == pytest.approx(exact.y[0, -1], abs=1e-9)


def test_faults(tmp_path):
    refused("name='my model' is not a C identifier", save_c, {"rhs": PLAIN}, tmp_path, name="my model")
    refused("Pass at least one Function", save_c, {}, tmp_path)
    given = dict(q=Q0, v=V0, parameters=PARAMETERS, coordinates=["a", "b"], t0=0, t1=1, steps=10)
    refused(r"values of these lengths: .*'q': 2", example_c, PLAIN, **given | {"q": [1.0]})
    refused("values of 1 states", example_c, PLAIN, **given | {"s": [1.0]})
    refused("values of 0 states", example_c, FILTERED, **given)
    refused("finite", example_c, PLAIN, **given | {"t1": np.inf})
    refused("at least one step", example_c, PLAIN, **given | {"steps": 0})
