"""States where the equations have no derivative are refused, and coefficients that change with time are doubted."""

import casadi as ca
import numpy as np
import pytest
from faults import refused, warned

import symmb as mb

BODY = mb.Body("b", 1.0, pose=mb.Particle())


def scene(force, parameters=None, **options) -> mb.Scene:
    system = mb.System(BODY, mb.Force("f", BODY.point(0, 0, 0), (force, 0, 0)), parameters=parameters)
    return mb.Scene(system, times=np.linspace(0, 5, 11), outputs={"x": BODY.x}, **options)


X, V = BODY.x, BODY.vx
JUMPS = {
    "sign": -10 * X - 5 * ca.sign(V),
    "comparison": -3 * X - ca.if_else(V > 0, 0.2, -0.2),
    "relay": -ca.sign(X) - 0.1 * V,
    "a small jump": -400 * X - 1e-3 * ca.sign(V),
    "floor": -X - 0.5 * ca.floor(X + 1),
}


@pytest.mark.parametrize("law", JUMPS)
def test_forces_that_jump_at_the_state_are_refused(law):
    refused("forces jump there", mb.linearize, scene(JUMPS[law]))


INFINITE = {
    "root of a distance": -10 * X - 2 * ca.sqrt(ca.fabs(X)) * ca.sign(X),
    "valve": -4 * X - 2 * ca.sqrt(ca.fabs(V)) * ca.sign(V),
    "norm": -10 * X - 2 * V / ca.sqrt(V**2 + BODY.vy**2 + BODY.vz**2),
    "power": -X - 2 * V * (V**2) ** 0.25,
}


@pytest.mark.parametrize("law", INFINITE)
def test_infinite_slopes_are_refused(law):
    refused(r"infinite or undefined at this state|slopes on both sides|jump", mb.linearize, scene(INFINITE[law]))
    p = mb.Parameters(k=10.0)
    refused(None, mb.ModalSimulator, scene(INFINITE[law] - p.k * X, p, box=mb.Box(k=(9, 11))))


def test_an_output_without_a_slope_is_named_where_it_is_asked_for():
    some = scene(-10 * X).with_outputs({"x": X, "distance": ca.sqrt(X**2 + BODY.y**2)})
    refused("output 'distance' has no finite derivative", mb.linearize, some)
    assert mb.linearize(some, outputs=["x"]).C.shape[0] == 1


@pytest.mark.parametrize("law", [-10 * X - 1e3 * ca.fmax(X - 0.05, 0) ** 1.5, -10 * X - 2 * V * ca.fabs(V)])
def test_smooth_laws_with_switches_are_linearised(law):
    lin = mb.linearize(scene(law))
    assert not lin.doubts
    assert np.abs(lin.eigenvalues).max() == pytest.approx(10**0.5)


@pytest.mark.parametrize("rate", [0.7, 6.0, 40.0])
@pytest.mark.parametrize("share", [0.02, 0.5])
def test_a_stiffness_that_is_a_law_of_time_is_doubted(rate, share):
    """Mathieu's equation, whose stability the eigenvalues at one time do not tell."""
    warned("A changes along the motion", mb.linearize, scene(-10 * (1 + share * ca.cos(rate * mb.t)) * X))


def test_a_force_that_is_a_law_of_time_is_not_doubted():
    assert not mb.linearize(scene(-10 * X - V + ca.sin(3 * mb.t))).doubts
