"""Regular runs raise no doubt: balanced forces, outputs that are rounding, energies far above the motion's."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import symmb as mb

GROUND = mb.Ground()
BOX = mb.Box(length=(0.9, 1.1))


def swing(outputs):
    """A rod in space that swings about y: nothing leads it out of the plane."""
    p = mb.Parameters(length=1.0)
    rod = mb.Body("rod", 1.0, (0.1, 0.1, 0.1), mb.Spatial())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0, 0), rod.point(-p.length, 0, 0), axis=(0, 1, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, 0, -9.81), parameters=p)
    return mb.Scene(system, {}, np.linspace(0, 1, 11), outputs(rod))


def test_outputs_that_are_zero_but_for_rounding_raise_no_doubt():
    scene = swing(lambda rod: {"x": rod.x, "aside": rod.y + 1e-16 * ca.sin(1e9 * rod.x)})
    run = mb.simulate(scene, mb.DormandPrince(), check=True)
    assert run.error is not None and run.error[:, 1].max() > 1e-3 * np.ptp(run["aside"])
    assert run.doubts == () and mb.prepare(scene, mb.DormandPrince()).doubts == ()
    assert mb.propagate(scene, mb.Scanning(3), BOX, mb.DormandPrince()).doubts == ()


def test_forces_in_balance_may_do_far_more_work_than_there_is_energy_of_motion():
    """A viscous creep under a slow push: v = F / d after m / d = 1e-4 s, of little kinetic energy."""
    block = mb.Body("block", 1.0, 0.0, mb.Particle())
    push = mb.Force("push", block.point(0, 0), (1 + ca.sin(mb.t) - 1e4 * block.vx, 0))
    scene = mb.Scene(mb.System(block, push), {}, np.linspace(0, 20, 5), {"x": block.x})
    run = mb.simulate(scene, mb.Rosenbrock())
    assert_allclose(run["x"], 1e-4 * (run.t + 1 - np.cos(run.t)), atol=2e-8)
    assert run.doubts == ()


def test_energy_that_differs_by_rounding_has_no_drift():
    """V = m g y is 1e12 times the energy of the swing."""
    rod = mb.Body("rod", 1.0, 0.0)
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, 1.0))
    scene = mb.Scene(mb.System(rod, hinge, mb.Gravity(0, -9.81)), {"rod.theta": 1e-6}, np.linspace(0, 3, 31))
    run = mb.simulate(scene, mb.DormandPrince())
    assert run.energy.kinetic.max() < 1e-11 and np.abs(run.energy.potential).max() > 9
    assert run.energy_drift == 0.0


def test_work_goes_on_at_switches_of_time_under_implicit_schemes():
    """A force of 1 N from 1 s to 2 s on 1 kg at 1 m/s does the work (2^2 - 1^2) / 2 J."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    push = mb.Force("push", ball.point(0, 0), (ca.if_else(ca.logic_and(mb.t > 1, mb.t < 2), 1, 0), 0))
    scene = mb.Scene(mb.System(ball, push), {"ball.vx": 1.0}, [0.0, 1.5, 3.0])
    for solver in (mb.Rosenbrock(), mb.NSTIFFSI2(step=1.0, rtol=1e-8)):
        assert_allclose(mb.simulate(scene, solver).work, [0, 0.625, 1.5], atol=1e-7)


def test_drift_of_rows_of_angles_is_no_share_of_lengths():
    """The rows of a hinge of a tiny rod keep its axis, to a tolerance of angles."""
    length, axis = 1e-6, np.array([0.6, 0.0, 0.8])
    rod = mb.Body("rod", 1.0, tuple(length**2 * c for c in (0.01, 0.1, 0.1)), mb.Spatial())
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0, 0), rod.point(-length, 0, 0), axis=tuple(axis))
    start = {"rod.rotation": mb.rotation(tuple(axis), 0.3), "rod.omega": tuple(2 * axis)}
    system = mb.System(rod, hinge, mb.Gravity(0, -length, 0))
    scene = mb.Scene(system, start, np.linspace(0, 10, 11), guess={"rod.x": length}, coordinates="body")
    run = mb.simulate(scene, mb.CVODES(stabilization=None))
    assert run.position_drift > 1e-6 * length
    assert not run.doubts


@pytest.mark.parametrize("rtol", [1e-11, 1e-12, 1e-13])
def test_work_of_a_clamp_has_no_more_digits_than_its_sum(rtol):
    """A crank that is driven presses a slider onto a stiff spring: 30 J of work, 8e-5 J of kinetic energy."""
    ground = mb.Ground()
    crank, rod = mb.Body("crank", 0.3, 1e-4, pose=mb.Planar()), mb.Body("rod", 0.1, 3e-5, pose=mb.Planar())
    pad = mb.Body("pad", 0.1, 1e-5, pose=mb.Planar())
    joints = [
        mb.Revolute("A", ground.point(0, 0), crank.point(0, 0)),
        mb.Revolute("B", crank.point(0.04, 0), rod.point(0, 0)),
        mb.Revolute("C", rod.point(0.06, 0), pad.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0.005), pad.point(0, 0), axis=(1, 0, 0)),
        mb.Motion("hand", crank.theta, 0.5 * ca.cos(np.pi * mb.t / 2) + 0.02),
    ]
    spring = mb.Spring("spring", ground.point(0.1485, 0.005), pad.point(0, 0), 2e6, length=0.05)
    system = mb.System(crank, rod, pad, *joints, spring)
    scene = mb.Scene(system, guess={"rod.theta": -0.2}, times=np.linspace(0, 1, 51), outputs={"pad": pad.x})
    run = mb.simulate(scene, mb.CVODES(rtol=rtol))
    angle = 0.5 * np.cos(np.pi * run.t / 2) + 0.02
    exact = 0.04 * np.cos(angle) + np.sqrt(0.06**2 - (0.04 * np.sin(angle) - 0.005) ** 2)
    assert_allclose(run["pad"], exact, atol=1e-10)
    assert not run.doubts
