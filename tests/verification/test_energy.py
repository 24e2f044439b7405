"""Energy: conserved without losses, and T + V - W constant with dampers, drives and forces that change with time."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from machines import GROUND, ball, pendulum, rods, wheel
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


# Regular runs raise no doubt; fixed steps that are too long change the energy, and a run tells it.


def test_outputs_that_are_zero_but_for_rounding_raise_no_doubt():
    """A rod in space that swings about y: nothing leads it out of the plane."""
    rod = pendulum(mb.Gravity(0, 0, -9.81), g=None, pose=mb.Spatial(), axis=(0, 1, 0))
    outputs = {"x": rod.body.x, "aside": rod.body.y + 1e-16 * ca.sin(1e9 * rod.body.x)}
    scene = rod.scene(outputs, np.linspace(0, 1, 11))
    run = mb.simulate(scene, mb.DormandPrince(), check=True)
    assert run.error is not None and run.error[:, 1].max() > 1e-3 * np.ptp(run["aside"])
    assert run.doubts == () and mb.prepare(scene, mb.DormandPrince()).doubts == ()
    assert mb.propagate(scene, mb.Scanning(3), mb.Box(length=(0.9, 1.1)), mb.DormandPrince()).doubts == ()


def test_forces_in_balance_may_do_far_more_work_than_there_is_energy_of_motion():
    """A viscous creep under a slow push: v = F / d after m / d = 1e-4 s, of little kinetic energy."""
    push = lambda m: mb.Force("push", m.at, (1 + ca.sin(mb.t) - 1e4 * m.ball.vx, 0))  # noqa: E731
    run = ball(push, g=None).run("x", np.linspace(0, 20, 5), solver=mb.Rosenbrock())
    assert_allclose(run["x"], 1e-4 * (run.t + 1 - np.cos(run.t)), atol=2e-8)
    assert run.doubts == ()


def test_energy_that_differs_by_rounding_has_no_drift():
    """V = m g y is 1e12 times the energy of the swing."""
    run = rods(1, length=2.0).run(None, np.linspace(0, 3, 31), {"rod0.theta": 1e-6}, solver=mb.DormandPrince())
    assert run.energy.kinetic.max() < 1e-11 and np.abs(run.energy.potential).max() > 9
    assert run.energy_drift == 0.0


def test_work_goes_on_at_switches_of_time_under_implicit_schemes():
    """A force of 1 N from 1 s to 2 s on 1 kg at 1 m/s does the work (2^2 - 1^2) / 2 J."""
    push = lambda m: mb.Force("push", m.at, (ca.if_else(ca.logic_and(mb.t > 1, mb.t < 2), 1, 0), 0))  # noqa: E731
    scene = ball(push, g=None).scene(None, [0.0, 1.5, 3.0], {"ball.vx": 1.0})
    for solver in (mb.Rosenbrock(), mb.NSTIFFSI2(step=1.0, rtol=1e-8)):
        assert_allclose(mb.simulate(scene, solver).work, [0, 0.625, 1.5], atol=1e-7)


def test_drift_of_rows_of_angles_is_no_share_of_lengths():
    """The rows of a hinge of a tiny rod keep its axis, to a tolerance of angles."""
    length, axis = 1e-6, np.array([0.6, 0.0, 0.8])
    rod = pendulum(length=length, inertia=0.1 * length**2, g=length, pose=mb.Spatial(), axis=tuple(axis))
    start = {"rod.rotation": mb.rotation(tuple(axis), 0.3), "rod.omega": tuple(2 * axis)}
    scene = rod.scene(None, np.linspace(0, 10, 11), start, guess={"rod.x": length}, coordinates="body")
    run = mb.simulate(scene, mb.CVODES(stabilization=None))
    assert run.position_drift > 1e-6 * length
    assert not run.doubts


@pytest.mark.parametrize("rtol", [1e-11, 1e-12, 1e-13])
def test_work_of_a_clamp_has_no_more_digits_than_its_sum(rtol):
    """A crank that is driven presses a slider onto a stiff spring: 30 J of work, 8e-5 J of kinetic energy."""
    crank, rod = mb.Body("crank", 0.3, 1e-4, pose=mb.Planar()), mb.Body("rod", 0.1, 3e-5, pose=mb.Planar())
    pad = mb.Body("pad", 0.1, 1e-5, pose=mb.Planar())
    joints = [
        mb.Revolute("A", GROUND.point(0, 0), crank.point(0, 0)),
        mb.Revolute("B", crank.point(0.04, 0), rod.point(0, 0)),
        mb.Revolute("C", rod.point(0.06, 0), pad.point(0, 0)),
        mb.Prismatic("guide", GROUND.point(0, 0.005), pad.point(0, 0), axis=(1, 0, 0)),
        mb.Motion("hand", crank.theta, 0.5 * ca.cos(np.pi * mb.t / 2) + 0.02),
    ]
    spring = mb.Spring("spring", GROUND.point(0.1485, 0.005), pad.point(0, 0), 2e6, length=0.05)
    system = mb.System(crank, rod, pad, *joints, spring)
    scene = mb.Scene(system, guess={"rod.theta": -0.2}, times=np.linspace(0, 1, 51), outputs={"pad": pad.x})
    run = mb.simulate(scene, mb.CVODES(rtol=rtol))
    angle = 0.5 * np.cos(np.pi * run.t / 2) + 0.02
    exact = 0.04 * np.cos(angle) + np.sqrt(0.06**2 - (0.04 * np.sin(angle) - 0.005) ** 2)
    assert_allclose(run["pad"], exact, atol=1e-10)
    assert not run.doubts


@pytest.mark.parametrize(("length", "damping"), [(0.6, 0.0), (1.0, 0.0), (1.0, 0.05)])
@pytest.mark.parametrize(
    "solver", [mb.Newmark, mb.BDFI3, mb.NSTIFFSI2, mb.GeneralizedAlpha, mb.HHT], ids=lambda solver: solver.__name__
)
@pytest.mark.filterwarnings("ignore:.*energy drifts:symmb.SymmbWarning")
def test_runs_that_are_visibly_wrong_are_doubted(solver, length, damping):
    """A pendulum that falls from its side, free and in oil, in steps of four lengths, against another solver."""
    oil = lambda m: mb.Torque("oil", m.rod, -m.p.damping * m.rod.omega)  # noqa: E731
    rod = pendulum(oil, length=length / 2, inertia=length**2 / 3, damping=damping)
    scene = rod.scene(times=np.linspace(0, 5, 51))
    right = mb.simulate(scene, mb.CVODES(rtol=1e-10)).values
    told = {}
    for step in (0.1, 0.05, 0.02, 5e-4):
        run = mb.simulate(scene, solver(step))
        error = np.abs(run.values - right).max() / np.ptp(right)
        told[error] = any("Use shorter steps" in doubt for doubt in run.doubts)
        assert error < 0.04 or told[error]
        assert error > 0.005 or not told[error]
    assert len(set(told.values())) == 2


@pytest.mark.parametrize(
    ("solver", "period", "share"),
    [
        pytest.param(solver, *jumps, marks=() if i == k else pytest.mark.long)
        for i, solver in enumerate((mb.GeneralizedAlpha, mb.HHT, mb.NSTIFFSI2))
        for k, jumps in enumerate([(0.02, 0.35), (0.05, 0.2), (0.013, 0.5)])
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
@pytest.mark.filterwarnings("ignore:.*The equations switch:symmb.SymmbWarning")
def test_steps_that_pass_over_many_jumps_are_doubted(solver, period, share):
    """A motor on pulses, against runs whose steps end at them."""
    pulses = ca.if_else(ca.fmod(mb.t, period) < share * period, 1.0, 0.0)
    rotor = wheel(lambda m: mb.Torque("motor", m.wheel, pulses - 0.1 * m.wheel.omega), inertia=0.02)
    scene = rotor.scene("omega", np.linspace(0, 1, 101))
    right = mb.simulate(scene, mb.DormandPrince(rtol=1e-12)).values
    for step in (0.3 * period * share, 1e-4):
        run = mb.simulate(scene, solver(step))
        error = np.abs(run.values - right).max() / np.ptp(right)
        told = any("of the steps" in doubt for doubt in run.doubts)
        assert told if error > 0.01 else error > 0.001 or not told
