"""Energy: conserved without losses, and T + V - W constant with dampers, drives and forces that change with time."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from machines import GROUND, ball, pendulum
from mechanisms import double_pendulum, spinning_body
from numpy.testing import assert_allclose

import symmb as mb

TIMES = np.linspace(0.0, 2.0, 41)
TIGHT = mb.CVODES(rtol=1e-11, stabilization=mb.Projection())


@pytest.mark.parametrize("scene", [double_pendulum, spinning_body])
def test_energy_is_conserved(scene):
    run = mb.simulate(scene(TIMES), TIGHT)
    assert np.ptp(run.energy.kinetic) > 0.1
    assert_allclose(run.energy.work, 0)
    assert run.energy_drift < 1e-8


ARM = partial(pendulum, length=0.4, mass=2.0)
WORKING = {
    "damper": lambda b, hinge: mb.Damper("d", GROUND.point(1, 1), b.point(0.4, 0), 3.0),
    "spring and damper": lambda b, hinge: mb.SpringDamper("s", GROUND.point(1, 1), b.point(0.4, 0), 30.0, 3.0, 0.5),
    "torsion damper": lambda b, hinge: mb.TorsionSpring("s", GROUND, b, 4.0, 0.5),
    "bushing": lambda b, hinge: mb.Bushing("s", GROUND.point(0.8, 0), b.point(0.4, 0), (20, 40, 60), 2.0, 3.0, 0.4),
    "force of time": lambda b, hinge: mb.Force("f", b.point(0.4, 0), (3 * ca.sin(5 * mb.t), 0)),
    "torque of velocity": lambda b, hinge: mb.Torque("f", b, -0.2 * b.omega[-1] ** 3),
    "stiffness of time": lambda b, hinge: mb.Spring("s", GROUND.point(1, 1), b.point(0.4, 0), 20 + 10 * mb.t, 0.5),
    "drive": lambda b, hinge: mb.Motion("m", hinge.angle, 0.3 * ca.sin(4 * mb.t)),
    "gravity of time": lambda b, hinge: mb.Force("g", b.point(0, 0), (0, -2.0 * mb.t)),
}


@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
@pytest.mark.parametrize("force", WORKING)
def test_the_work_of_what_has_no_potential_balances_the_energy(force, pose):
    run = ARM(lambda m: WORKING[force](m.rod, m.hinge), pose=pose).run(None, TIMES, solver=TIGHT)
    assert np.abs(run.energy.work).max() > 1e-2
    assert run.energy_drift < 1e-8
    if "damper" in force:
        assert (np.diff(run.energy.work) <= 1e-12).all()


@pytest.mark.parametrize("solver", [mb.RungeKutta(steps=2000), mb.Collocation(steps=200), mb.IDAS(1e-11)], ids=repr)
def test_every_kind_of_solver_integrates_the_work(solver):
    run = ARM(lambda m: mb.TorsionSpring("s", GROUND, m.rod, 4.0, 0.5)).run(None, TIMES, solver=solver)
    assert run.energy.work[-1] < -0.5
    assert run.energy_drift < 1e-7


def test_a_driven_cart_takes_the_work_of_its_drive():
    """m a = F along x = sin(t): the work is the kinetic energy gained."""
    cart = ball(lambda m: mb.Motion("drive", m.ball.x, ca.sin(mb.t)), mass=3.0, g=None)
    run = cart.run(None, TIMES, solver=TIGHT)
    assert_allclose(run.energy.kinetic, 1.5 * np.cos(TIMES) ** 2, atol=1e-9)
    assert_allclose(run.energy.work, 1.5 * np.cos(TIMES) ** 2 - 1.5, atol=1e-9)
    assert_allclose(run["drive.lam[0]"], 3.0 * np.sin(TIMES), atol=1e-9)


@pytest.mark.filterwarnings("ignore:.*the mount turns by more than 0.5 rad:symmb.SymmbWarning")
def test_momentum_of_a_free_pair_is_conserved():
    """Two bodies tied by a spring, a damper and a bushing, spinning in space."""
    a, b = (mb.Body(name, m, (0.3, 0.2, 0.1), mb.Spatial()) for name, m in (("a", 1.0), ("b", 2.5)))
    system = mb.System(
        a, b,
        mb.SpringDamper("spring", a.point(0.1, 0, 0.2), b.point(0, 0.3, 0), 40.0, 1.0, 0.3),
        mb.SpringDamper("tie", a.point(0, 0.2, 0), b.point(0.1, 0, 0.1), 10.0, 2.0),
        mb.Bushing("bushing", a.point(0, 0.1, 0), b.point(0.2, 0, 0), (5, 10, 15), 0.3, (1, 2, 3), 0.2),
    )  # fmt: skip
    start = {"a.x": 1.0, "a.vx": 0.3, "a.omega": (1, 2, -1), "b.vy": -0.7, "b.omega": (0, -3, 2)}
    run = mb.simulate(mb.Scene(system, start, TIMES), mb.CVODES(rtol=1e-11))
    linear, angular = 0, 0
    for body, m in ((a, 1.0), (b, 2.5)):
        linear += m * body.frame.velocity
        spin = body.rotation @ (ca.DM([0.3, 0.2, 0.1]) * body.omega)
        angular += m * ca.cross(body.frame.r, body.frame.velocity) + spin
    for momentum in (run(linear), run(angular)):
        assert np.abs(momentum).max() > 0.3
        assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-8)
    assert run.energy.work[-1] < -0.5
    assert run.energy_drift < 1e-8
