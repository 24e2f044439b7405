"""Bounds stay within what the formula of an output can give, whatever a surrogate says between its nodes."""

import casadi as ca
import numpy as np
import pytest

import symmb as mb

P = mb.Parameters(k=100.0, c=1.0)
BALL = mb.Body("ball", 1.0, pose=mb.Particle())
FLOOR = ca.if_else(BALL.y < 0, ca.fmax(0, -P.k * BALL.y - P.c * BALL.vy), 0)
OUTPUTS = {
    "force": (FLOOR, 0.0, np.inf),
    "share": (ca.tanh(BALL.vy / 0.01), -1.0, 1.0),
    "contact": (ca.if_else(BALL.y < 0, 1.0, 0.0), 0.0, 1.0),
    "depth": (ca.fabs(ca.fmin(BALL.y, 0)), 0.0, np.inf),
    "speed": (ca.norm_2(ca.vertcat(BALL.vx, BALL.vy)), 0.0, np.inf),
    "limited": (ca.fmin(ca.fmax(P.k * BALL.y, -3.0), 5.0), -3.0, 5.0),
    "stiffness": (P.k * ca.fmin(mb.t, 1.0), None, None),
}


@pytest.mark.parametrize("method", [mb.PolynomialChaos(), mb.PolynomialChaos(order=4)], ids=repr)
@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
def test_bounds_stay_within_what_outputs_can_be(method):
    system = mb.System(BALL, mb.Gravity(0, -9.81), mb.Force("floor", BALL.point(0, 0), (0, FLOOR)), parameters=P)
    outputs = {name: y for name, (y, *_) in OUTPUTS.items()}
    scene = mb.Scene(system, {"ball.y": 0.5}, np.linspace(0, 3, 61), outputs, box=mb.Box(k=(90, 110), c=(0.9, 1.1)))
    bounds = mb.propagate(scene, method)
    for i, (_, low, high) in enumerate(OUTPUTS.values()):
        low, high = (90 * np.fmin(bounds.t, 1), 110 * np.fmin(bounds.t, 1)) if low is None else (low, high)
        slack = 1e-12 * np.abs(bounds.upper[:, i])
        assert (bounds.lower[:, i] >= low - slack).all() and (bounds.upper[:, i] <= high + slack).all()
    assert bounds.lower[:, 0].min() == 0.0
