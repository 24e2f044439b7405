"""Taylor coefficients in the parameters, of starts and of trajectories, against differences of tight runs."""

import casadi as ca
import numpy as np
import pytest
from conftest import ALL_SOLVERS
from mechanisms import double_pendulum, spinning_body
from numpy.testing import assert_allclose

import symmb as mb
from models import double_pendulum as pendulum

TIMES = np.linspace(0.0, 0.8, 5)
DIRECTIONS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, -0.7, 0.3]])
ORDER = 3
NODES = np.arange(-4, 5)


def coefficients(values, h):
    """Taylor coefficients 0 ... 3 from values (9, ...) at the nodes times h."""
    fit = np.polynomial.polynomial.polyfit(NODES, values.reshape(9, -1), 8)[: ORDER + 1]
    return (fit / h ** np.arange(ORDER + 1)[:, None]).reshape(ORDER + 1, *values.shape[1:])


def crank():
    """A damped slider-crank with a spring; three parameters in masses, lengths, force laws and the start."""
    p = mb.Parameters(r=0.3, k=60.0, a=0.7)
    crank, rod, slider = (mb.Body(name, 1.0 + p.r, 0.1 + p.r**2, mb.Planar()) for name in ("crank", "rod", "slider"))
    ground = mb.Ground()
    system = mb.System(
        crank, rod, slider,
        mb.Revolute("main", ground.point(0, 0), crank.point(-p.r / 2, 0)),
        mb.Revolute("pin", crank.point(p.r / 2, 0), rod.point(-0.5, 0)),
        mb.Revolute("wrist", rod.point(0.5, 0), slider.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), slider.point(0, 0), axis=(1, 0, 0)),
        mb.Gravity(0, -9.81),
        mb.SpringDamper("spring", ground.point(2, 0), slider.point(0, 0), p.k, 2.0, 0.5),
        mb.Torque("drive", crank, ca.sin(mb.t) * p.k / 10),
        parameters=p,
    )  # fmt: skip
    outputs = {"x": slider.x, "angle": crank.theta, "rate": p.a * rod.omega, "force": system.reaction("guide").fy}
    return mb.Scene(
        system, {"crank.theta": p.a, "crank.omega": 1 + p.a}, TIMES, outputs,
        guess={"slider.x": 1.2, "rod.x": 0.7}, name="slider-crank",
    )  # fmt: skip


NOMINAL = np.array([0.3, 60.0, 0.7])
SCALE = np.array([1.0, 100.0, 1.0])  # directions of similar effect


@pytest.fixture(scope="module")
def expected():
    simulator = mb.DAESimulator(crank(), mb.CVODES(rtol=1e-13))
    h = 0.01
    runs = [simulator.run(NOMINAL + h * NODES[:, None] * SCALE * d).Y for d in DIRECTIONS]
    return np.stack([coefficients(Y, h) for Y in runs], axis=1)


# BDF shows the same kind.
LARGE = mb.GeneralizedAlpha | mb.HHT | mb.Newmark | mb.NSTIFFSI2 | mb.Rosenbrock | mb.Collocation
TRIED = [
    pytest.param(s, marks=pytest.mark.long) if isinstance(s, LARGE) else s
    for s in ALL_SOLVERS
    if not isinstance(s, mb.StabilizedIndex2)
]


@pytest.mark.parametrize("solver", TRIED, ids=repr)
def test_trajectories_of_every_solver(solver, expected):
    large = mb.Collocation | mb.NSTIFFSI2 | mb.BDFI3  # whose Newton matrices get large
    order = 2 if isinstance(solver, large) else ORDER
    jets = mb.DAESimulator(crank(), solver).jets(NOMINAL, DIRECTIONS * SCALE, order)
    assert jets.shape == (order + 1, len(DIRECTIONS), len(TIMES), 4)
    second_order = isinstance(solver, mb.NSTIFFSI2 | mb.GeneralizedAlpha | mb.HHT | mb.Newmark | mb.BDFI3)
    for j in range(order + 1):
        scale = np.abs(expected[j]).max(axis=(0, 1))
        error = np.abs(jets[j] - expected[j]).max(axis=(0, 1)) / scale
        assert (error < (2e-2 if second_order else (1e-6, 1e-6, 1e-5, 1e-4)[j])).all(), (j, error)


@pytest.mark.parametrize("order", [1, 2])
def test_lower_orders_are_the_first_of_the_higher(order):
    simulator = mb.DAESimulator(crank(), mb.CVODES(rtol=1e-11))
    high = simulator.jets(NOMINAL, DIRECTIONS * SCALE, 3)
    low = simulator.jets(NOMINAL, DIRECTIONS * SCALE, order)
    for j in range(order + 1):
        assert_allclose(low[j], high[j], atol=1e-7 * np.abs(high[j]).max())


@pytest.mark.parametrize("stabilization", [mb.Baumgarte(), mb.Projection()], ids=repr)
def test_trajectories_with_stabilization(stabilization, expected):
    simulator = mb.DAESimulator(crank(), mb.CVODES(rtol=1e-12, stabilization=stabilization))
    jets = simulator.jets(NOMINAL, DIRECTIONS * SCALE, 2)
    for j in range(3):
        assert_allclose(jets[j], expected[j], atol=1e-5 * np.abs(expected[j]).max())


def test_the_third_order_is_the_difference_of_second_orders():
    """Of the paper's pendulum over 10 s: c_2 along p_0 + eps u changes by 3 c_3 with eps."""
    simulator = mb.DAESimulator(pendulum.scene().with_times(np.linspace(0, 10, 21)), mb.DormandPrince(rtol=1e-12))
    nominal, h, directions = np.ones(2), 1e-4, np.array([[0.05, 0.0], [0.0, 0.05], [0.03, -0.04]])
    third = simulator.jets(nominal, directions, 3)[3]
    for m, u in enumerate(directions):
        ahead, behind = (simulator.jets(nominal + s * h * u, u[None], 2)[2, 0] for s in (1, -1))
        difference = (ahead - behind) / (6 * h)
        assert_allclose(third[m], difference, atol=1e-5 * np.abs(difference).max())


def test_trajectories_in_space():
    """Three parameters of a body on a ball joint: mass, arm and tilt."""
    p = mb.Parameters(m=1.5, arm=0.4, tilt=0.5)
    top = mb.Body("top", p.m, (0.02, 0.025, p.m * 0.01), mb.Spatial())
    tip = mb.Spherical("tip", mb.Ground().point(0, 0), top.point(0, 0, -p.arm))
    start = {"top.rotation": mb.rotation((0, 1, 0), p.tilt), "top.omega": (0.2, p.tilt, 8.0)}
    system = mb.System(top, tip, mb.Gravity(0, 0, -9.81), parameters=p)
    outputs = {"x": top.x, "y": top.y, "w": top.omega[0], "pull": system.reaction("tip").fz}
    simulator = mb.DAESimulator(mb.Scene(system, start, TIMES, outputs), mb.CVODES(rtol=1e-13))
    nominal, h = np.array([1.5, 0.4, 0.5]), 0.004
    jets = simulator.jets(nominal, DIRECTIONS, ORDER)
    for m, d in enumerate(DIRECTIONS):
        fit = coefficients(simulator.run(nominal + h * NODES[:, None] * d).Y, h)
        for j in range(ORDER + 1):
            assert_allclose(jets[j, m], fit[j], atol=(1e-8, 1e-7, 1e-5, 1e-3)[j] * np.abs(fit[j]).max())


def implicit_start():
    """A rod on a hinge, of which the height is listed: angle and velocities follow."""
    p = mb.Parameters(l=1.2, y=-0.45)
    rod = mb.Body("rod", p.l, p.l**3 / 12, mb.Planar())
    system = mb.System(rod, mb.Revolute("hinge", mb.Ground().point(0, 0), rod.point(0, p.l / 2)), parameters=p)
    return mb.Scene(system, {"rod.y": p.y, "rod.vy": 0.7}, guess={"rod.theta": 0.6, "rod.x": 0.3})


@pytest.mark.parametrize(
    ("scene", "nominal"), [(double_pendulum, [1.0, 0.8]), (spinning_body, [1.5, 0.0]), (implicit_start, [1.2, -0.45])]
)
def test_starts(scene, nominal):
    start = mb.DAESimulator(scene(), mb.DormandPrince()).start
    h, directions = 0.005, np.array([[1.0, 0.0], [0.0, 1.0], [0.7, -0.4]])
    jets = start.jets(np.array(nominal), directions, ORDER)
    for m, direction in enumerate(directions):
        x, reasons = start.states(nominal + h * NODES[:, None] * direction)
        assert not any(reasons)
        fit = coefficients(x, h)
        for j in range(ORDER + 1):
            assert_allclose(jets[j][m], fit[j], atol=1e-6 * max(1, np.abs(fit[j]).max()))
