"""Friction: its formula, decay and standstill, stick and slip in closed form, and slip in two directions."""

import casadi as ca
import numpy as np
import problems
import pytest
from machines import GROUND, run_of
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import symmb as mb
from models import stick_slip

KNOWN = problems.read("contact")["coulomb"]
SOLVERS = (mb.DormandPrince(), mb.CVODES(rtol=1e-10, stiff=True), mb.Rosenbrock())
solvers = pytest.mark.parametrize("solver", SOLVERS, ids=repr)


def laws(*laws):
    return pytest.mark.parametrize("law", laws, ids=["Coulomb", "Bristle"])


def rubbing(law, normal, *more, times, solver=None, mass=1.0, **start):
    """A run of a block under friction along x and further elements, which are functions of the block."""
    block = mb.Body("block", mass, pose=mb.Particle())
    rub = mb.Friction("rub", GROUND.point(0, 0), block.point(0, 0), (1, 0, 0), normal, law)
    start = {f"block.{name}": value for name, value in start.items()}
    return run_of(block, rub, *(element(block) for element in more), start=start, times=times, solver=solver)


def decaying(law, times, solver):
    """The run of the block of the reference, let go from x0 on a spring."""
    N, m, k, x0 = (float(KNOWN["parameters"][name]) for name in ("N", "m", "k", "x0"))
    spring = lambda block: mb.Spring("spring", GROUND.point(0, 0), block.point(0, 0), k)  # noqa: E731
    return rubbing(law, N, spring, times=times, solver=solver, mass=m, x=x0, y=0.0, z=0.0)


@solvers
@pytest.mark.parametrize(
    ("law", "swing", "end"),
    [
        # The velocity of the transition is reached a moment earlier or later: swings are off by less than 1e-7 of 1 m.
        # At rest the block creeps by k x speed / (4 mu N) = 2e-5 m/s.
        (mb.Coulomb(KNOWN["parameters"]["mu"], 1e-3), 1e-7, 2e-4),
        # Bristles give way by mu / stiffness = 2.5e-5 m at each swing, and hold.
        (mb.Bristle(KNOWN["parameters"]["mu"], 1e4, damping=60.0), 2e-4, 2e-4),
    ],
    ids=["Coulomb", "Bristle"],
)
def test_decay_by_friction(law, swing, end, solver):
    times, values = np.array(KNOWN["reversals"]).T
    every = np.concatenate([np.linspace(0, 2, 201), times, [10.0]])
    order = np.argsort(every)
    run = decaying(law, every[order], solver)
    x = np.empty(len(every))
    x[order] = run["block.x"]
    assert_allclose(x[201:203], values, atol=swing)
    assert x[203] == pytest.approx(KNOWN["final_x"], abs=end)
    assert run.energy_drift < 1e-5
    assert np.diff(run.energy.work).max() < 4e-5  # bristles give back N mu^2 / (2 k) at most


@pytest.mark.filterwarnings("ignore::symmb.SymmbWarning")
@pytest.mark.parametrize(("normal", "is_told"), [(lambda t: 3 - 4 * t, True), (lambda t: 3 - 2 * t, False)])
def test_a_normal_force_below_0_is_doubted(normal, is_told):
    for law in (mb.Coulomb(0.2, 0.1), mb.Bristle(0.2, 1e3)):
        for force, told in ((normal(mb.t), is_told), (ca.fmax(normal(mb.t), 0), False)):
            doubts = rubbing(law, force, vx=3.0, times=np.linspace(0, 1, 11), solver=mb.DormandPrince()).doubts
            assert [d for d in doubts if "normal force is negative at t = 0.75" in d] == [*doubts][: int(told)]


def test_a_smaller_transition_comes_closer_to_coulomb_s_law():
    times = [time for time, _ in KNOWN["reversals"]]
    runs = (decaying(mb.Coulomb(0.25, speed), [0.0, *times, 10.0], SOLVERS[0]) for speed in (1e-2, 1e-3))
    creep = [abs(run["block.x"][-1] - KNOWN["final_x"]) for run in runs]
    assert creep[1] < 0.15 * creep[0]


def test_bristles_hold_a_block_that_is_shaken():
    """Half of what would break it away, at 5 Hz: nothing moves on, while the smooth law creeps."""
    push = lambda block: mb.Force("push", block.point(0, 0), (1.5 + 0.5 * ca.sin(10 * np.pi * mb.t), 0))  # noqa: E731
    scene = {"times": [0.0, 1.0, 2.0, 20.0], "solver": mb.Rosenbrock(rtol=1e-9)}
    bristles, smooth = mb.Bristle(0.3, 1e4, damping=60.0, static=0.4), mb.Coulomb(0.3, 1e-3, static=0.4)
    held, crept = (rubbing(law, 10.0, push, **scene)["block.x"] for law in (bristles, smooth))
    assert 0.5e-5 < held[1] < 3e-5  # N k z = 1.5 ... 2
    assert_allclose(held[1:], held[1], atol=1e-9)
    assert crept[-1] > 1e-3


@solvers
def test_a_block_on_a_belt_moves_alike_by_every_solver(solver):
    """Lightly stiff bristles, so that explicit steps can follow them."""
    scene = stick_slip.scene(bristles=1e4)
    run, fine = (mb.simulate(scene, s) for s in (solver, mb.Rosenbrock(rtol=1e-10)))
    assert_allclose(run["x"], fine["x"], atol=1e-6)
    assert run.energy_drift < 1e-6


@pytest.mark.parametrize("rtol", [1e-8, 1e-9, 1e-10, 1e-11])
@pytest.mark.parametrize("bristles", [3e3, 1e4])
def test_the_belt_keeps_its_drive_where_the_block_sticks(rtol, bristles):
    """A motion at rest near a switch is not moved along by the rounding of the switch."""
    run = mb.simulate(stick_slip.scene(bristles=bristles), mb.CVODES(rtol=rtol, stiff=True))
    assert run.position_drift < 1e-7


def test_stick_and_slip_of_a_block_on_a_belt():
    m, k, V, N, static, kinetic = 1.0, 100.0, 0.1, 10.0, 0.4, 0.25
    A, w = (static - kinetic) * N / k, np.sqrt(k / m)
    slips = 2 * (np.pi - np.arctan(A * w / V)) / w
    first = static * N / k / V  # breaks away
    period = 2 * A / V + slips

    def closed(t):
        since = (t - first) % period
        slip = kinetic * N / k + A * np.cos(w * since) + V / w * np.sin(w * since)
        stick = kinetic * N / k - A + V * (since - slips)
        return np.where(t < first, V * t, np.where(since < slips, slip, stick))

    times = np.linspace(0, 3, 3001)
    run = mb.simulate(stick_slip.scene(bristles=1e7, stribeck=1e-4), SOLVERS[2], times=times)
    x = run["x"]
    tops = 1 + np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:]))
    assert_allclose(np.diff(times[tops]), period, rtol=3e-3)
    assert x.max() == pytest.approx(kinetic * N / k + np.hypot(A, V / w), rel=2e-3)
    assert_allclose(x, closed(times), atol=1e-3)
    sticks = (times > 0.05) & (times < 0.9 * first)
    assert np.abs(run["slip"][sticks]).max() < 1e-4 * V
    assert run.energy_drift < 1e-6


@pytest.mark.parametrize("static", [None, 0.5])
def test_a_smooth_law_is_that_of_brown_and_mcphee(static):
    slip = ca.SX.sym("slip")
    force, states = mb.Coulomb(0.3, 0.02, static).resistance("rub", slip, ca.SX(7.0))
    v = np.array([-3.0, -0.02, -1e-3, 1e-3, 0.01, 0.02, 0.05, 3.0])
    u = v / 0.02
    mu = 0.3 * np.tanh(4 * u) + (0.2 * u / (0.25 * u**2 + 0.75) ** 2 if static else 0)
    assert_allclose(ca.Function("f", [slip], [force])(v[None]).full()[0], -7 * mu, rtol=1e-6)
    assert not states


@laws(mb.Coulomb(0.3, 0.02, 0.5), mb.Bristle(0.3, 1e4, 10.0, 0.5))
@pytest.mark.parametrize("n", [1, 2])
def test_derivatives_are_finite_at_rest(law, n):
    slip = ca.SX.sym("slip", n)
    force, states = law.resistance("rub", slip, ca.SX(7.0))
    x = ca.vertcat(slip, *[s.sx for s in states])
    expression = ca.vertcat(force, *[s.rate for s in states])
    for _ in range(4):
        f = ca.Function("f", [x], [expression])
        for state in (np.zeros(x.numel()), np.eye(x.numel())[0], 1e-5 * np.ones(x.numel())):
            assert np.isfinite(f(state).full()).all()
        expression = ca.jtimes(expression, x, ca.DM.ones(x.numel()))


def sliding(law, pose, inertia, times, **start):
    """A ball of radius 0.1 m on a table, pressed by its weight, where its contact is in balance."""
    ball = mb.Body("ball", 2.0, inertia, pose)
    planar = isinstance(pose, mb.Planar)
    up, k, g = (0, 1, 0) if planar else (0, 0, 1), 1e6, 10.0
    contact = mb.Contact("floor", ball.point(0, 0), GROUND.point(0, 0), up, mb.KelvinVoigt(k, 500.0), 0.1, law)
    start = {"y" if planar else "z": 0.1 - 2.0 * g / k, **start}
    start = {f"ball.{name}": value for name, value in start.items()}
    return mb.Scene(mb.System(ball, contact, mb.Gravity(*(-g * c for c in up))), start, times)


@laws(mb.Coulomb(0.2, 1e-3), mb.Bristle(0.2, 1e4, damping=30.0))
@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
def test_a_sliding_ball_starts_to_roll(pose, law):
    """v = v0 - mu g t until it rolls with 5 / 7 of its speed, for a moment of inertia of 2 / 5 m r^2."""
    J = 0.4 * 2.0 * 0.1**2
    inertia = J if isinstance(pose, mb.Planar) else (J, J, J)
    run = mb.simulate(sliding(law, pose, inertia, np.linspace(0, 1, 101), vx=2.0), SOLVERS[0])
    end = 2 / 7 * 2.0 / (0.2 * 10)
    assert_allclose(run["ball.vx"], np.maximum(2.0 - 2.0 * run.t, 2.0 - 2.0 * end), atol=4e-3)
    spin = run["ball.omega"] if isinstance(pose, mb.Planar) else -run["ball.omega_y"]
    assert -0.1 * spin[-1] == pytest.approx(10 / 7, abs=2e-3)
    assert run.energy_drift < 1e-6


@laws(mb.Coulomb(0.2, 1e-3), mb.Bristle(0.2, 1e4, damping=30.0))
def test_a_block_slides_straight_on_and_stops(law):
    """In any direction on a table: v^2 / (2 mu g) far."""
    run = mb.simulate(sliding(law, mb.Particle(), 0.0, [0.0, 0.25, 0.5, 1.0], vx=0.6, vy=-0.8), SOLVERS[2])
    far = np.array([0.6, -0.8]) * 1.0 / (2 * 0.2 * 10)
    assert_allclose([run["ball.x"][-1], run["ball.y"][-1]], far, atol=5e-4)
    assert_allclose([run["ball.vx"][1], run["ball.vy"][1]], [0.3, -0.4], atol=1e-3)
    assert_allclose([run["ball.vx"][2:], run["ball.vy"][2:]], 0, atol=1e-2)


def test_bristles_follow_their_published_equation():
    """Slip to and fro by a drive, against the scalar elasto-plastic model written by hand."""
    mu, k, c = 0.3, 1e3, 30.0
    drive = lambda block: mb.Motion("drive", block.x, 1e-3 * ca.sin(20 * mb.t))  # noqa: E731
    times = np.linspace(0, 1, 101)
    run = rubbing(mb.Bristle(mu, k, c), 5.0, drive, times=times, solver=mb.DormandPrince(rtol=1e-9))

    def rate(t, z):
        v, share = 0.02 * np.cos(20 * t), np.abs(z) * k / mu
        s = np.clip((share**2 - 0.49) / 0.51, 0, 1)
        alpha = np.where(v * z > 0, s**3 * (10 - 15 * s + 6 * s**2), 0)
        return v * (1 - alpha * share**2)

    z = solve_ivp(rate, (0, 1), [0.0], "DOP853", times, rtol=1e-10, atol=1e-14, max_step=1e-3).y[0]
    assert np.abs(z).max() > 0.99 * mu / k
    assert_allclose(run["rub.bristle"], z, atol=1e-8)
    damping = c * rate(times, z)
    force = -5 * (k * z + damping / np.sqrt(1 + (damping / mu) ** 2))
    # M v' + Phi_v' lam = Q
    assert_allclose(run["drive.lam[0]"], force + 0.4 * np.sin(20 * times), atol=1e-4)
