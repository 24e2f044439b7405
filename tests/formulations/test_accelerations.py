"""Accelerations as outputs, against closed forms."""

import casadi as ca
import machines
import numpy as np
import pytest
from faults import refused
from numpy.testing import assert_allclose

import symmb as mb

TIMES = np.linspace(0, 2, 41)


def driven_crank():
    """A crank of length 0.3 at 5 rad/s draws a ram by a rod of length 1."""
    ground, p = mb.Ground(), mb.Parameters(crank=0.3, rod=1.0)
    crank, rod = mb.Body("crank", 1.0, 0.1), mb.Body("rod", 1.0, 0.1)
    ram = mb.Body("ram", 5.0, 1.0)
    system = mb.System(
        crank, rod, ram,
        mb.Revolute("main", ground.point(0, 0), crank.point(0, 0)),
        mb.Revolute("pin", crank.point(p.crank, 0), rod.point(0, 0)),
        mb.Revolute("wrist", rod.point(p.rod, 0), ram.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), ram.point(0, 0), axis=(1, 0, 0)),
        mb.Motion("drive", crank.theta, 5 * mb.t),
        parameters=p,
    )  # fmt: skip
    return system, ram, {"ram.x": 1.3}


@pytest.mark.parametrize("solver", [None, mb.DormandPrince(), mb.Rosenbrock(), mb.IDAS()], ids=repr)
def test_the_ram_of_a_crank_accelerates_as_its_closed_form(solver):
    system, ram, guess = driven_crank()
    outputs = {"a": system.ddt(ram.vx), "twice": system.ddt(mb.ddt(2 * ram.x))}
    run = mb.simulate(mb.Scene(system, {}, TIMES, outputs, guess=guess), solver)
    x = 0.3 * ca.cos(5 * mb.t) + ca.sqrt(1 - (0.3 * ca.sin(5 * mb.t)) ** 2)
    exact = ca.Function("a", [mb.t], [ca.jacobian(ca.jacobian(x, mb.t), mb.t)])
    assert_allclose(run["a"], np.array(exact(TIMES)).ravel(), atol=1e-6)
    assert_allclose(run["twice"], 2 * run["a"], atol=1e-9)
    assert_allclose(run(system.ddt(ram.vx**2)), 2 * run["ram.vx"] * run["a"], atol=1e-9)


def test_bounds_of_accelerations():
    """The largest acceleration of the ram, where the crank points outwards at the start, is w^2 c (1 + c / r)."""
    system, ram, guess = driven_crank()
    scene = mb.Scene(system, {}, TIMES, {"a": system.ddt(ram.vx)}, guess=guess, box=mb.Box(crank=(0.29, 0.31)))
    lower, upper = (-25 * c * (1 + c) for c in (0.31, 0.29))
    for method in (mb.PolynomialChaos(), mb.Taylor(order=2)):
        bounds = mb.propagate(scene, method)
        assert_allclose([bounds.lower[0, 0], bounds.upper[0, 0]], [lower, upper], rtol=1e-3)
    assert mb.DAESimulator(scene, mb.DormandPrince()).units == ("m/s^2",)


def test_free_bodies_and_what_nothing_moves():
    free = machines.ball()
    ball = free.ball
    outputs = {name: free.system.ddt(rate) for name, rate in (("y", ball.vy), ("x", ball.vx), ("xx", ball.x * ball.vx))}
    run = free.run(outputs, TIMES, {"ball.vx": 2.0})
    assert_allclose(run.values, np.full((41, 3), [-9.81, 0, 4.0]))


def test_rates_of_what_is_unknown_or_solved_for_are_errors():
    system, _, _ = driven_crank()
    refused(r"ddt: symbol 'stranger\.vx' does not belong", system.ddt, mb.Body("stranger", 1.0, 0.1).vx)
    refused(r"ddt: 'main\.lam", system.ddt, system.lam("main")[0])
