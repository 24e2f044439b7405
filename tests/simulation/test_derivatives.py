"""Derivatives of runs: gradients by JAX and PyTorch, and Taylor coefficients, against runs by hand and differences."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from conftest import ALL_SOLVERS
from faults import refused, warned
from machines import linkage
from mechanisms import double_pendulum, spinning_body
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from small_scenes import particle

import symmb as mb
from models import double_pendulum as pendulum

TIGHT = mb.DormandPrince(rtol=1e-12, atol=1e-13)
TIMES = np.linspace(0.0, 1.0, 6)
POINTS = np.array([[0.9, 0.5, 0.3], [1.1, 0.4, -0.2], [1.0, 0.7, 0.6], [1.3, 0.2, 1.0]])


@pytest.fixture
def jax():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    return jax


def pendulum_on_a_spring():
    """A mass on a spring of length l about a pivot, with parameters l, the damping c and the angle a at the start."""
    p, bob = mb.Parameters(l=1.0, c=0.5, a=0.3), mb.Body("bob", mass=1.0, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(0, 0), bob.point(0, 0), 50.0, p.c, p.l)
    system = mb.System(bob, spring, mb.Gravity(0, -9.81), parameters=p)
    return mb.Scene(system, {"bob.x": p.a, "bob.y": -p.l}, TIMES, {"x": bob.x, "y": bob.y, "vx": bob.vx})


def by_hand(u):
    """Outputs (n_t, 3) for parameters (3,), which may be complex."""
    length, c, a = u

    def rates(t, z):
        x, y, vx, vy = z
        r = np.sqrt(x * x + y * y)
        pull = 50.0 * (r - length) + c * (x * vx + y * vy) / r
        return np.array([vx, vy, -pull * x / r, -pull * y / r - 9.81])

    start = np.array([a, -length, 0, 0], dtype=complex)
    return solve_ivp(rates, (0, TIMES[-1]), start, "DOP853", TIMES, rtol=1e-13, atol=1e-15).y[:3].T


def slopes_by_hand(u):
    """Derivatives (n_t, 3, 3) by complex steps."""
    return np.stack([by_hand(u + 1e-30j * e).imag / 1e-30 for e in np.eye(3)], -1)


def test_sensitivities_are_those_of_complex_steps():
    found = mb.sensitivities(pendulum_on_a_spring(), solver=TIGHT)
    np.testing.assert_allclose(found.values, slopes_by_hand(np.array([1.0, 0.5, 0.3])), rtol=1e-8, atol=1e-8)


def test_jax_has_values_and_gradients_of_batches(jax):
    f = mb.jax_function(pendulum_on_a_spring(), solver=TIGHT)
    slopes = np.array([slopes_by_hand(u) for u in POINTS])
    np.testing.assert_allclose(f(POINTS), [by_hand(u).real for u in POINTS], rtol=1e-8, atol=1e-8)
    for jacobian in (jax.jacrev, jax.jacfwd):
        np.testing.assert_allclose(jax.jit(jax.vmap(jacobian(f)))(POINTS), slopes, rtol=1e-8, atol=1e-8)
    weights = np.arange(18.0).reshape(6, 3)
    gradient = jax.grad(lambda u: (weights * f(u)).sum())(POINTS)
    np.testing.assert_allclose(gradient, np.einsum("ty,ntyp->np", weights, slopes), rtol=1e-8)
    assert f(POINTS[0].astype(np.float32)).dtype == np.float64 and f(np.zeros((0, 3))).shape == (0, 6, 3)
    refused(r"shape \(..., 3\), with the values of l, c, a along .* axis, got an array of shape \(2,\)", f, np.ones(2))


def test_torch_has_values_and_gradients_of_batches():
    torch = pytest.importorskip("torch")
    f = mb.torch_function(pendulum_on_a_spring(), ["a", "l"], solver=TIGHT)
    u = torch.tensor(POINTS[:1, [2, 0]], dtype=torch.float64, requires_grad=True)
    y = f(u)
    weights = torch.arange(18.0, dtype=torch.float64).reshape(6, 3)
    (weights * y).sum().backward()
    slopes = slopes_by_hand(POINTS[0])[..., [2, 0]]
    np.testing.assert_allclose(y.detach()[0], by_hand(POINTS[0]).real, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(u.grad[0], np.einsum("ty,typ->p", weights, slopes), rtol=1e-8)
    assert f(u.detach()).requires_grad is False
    refused(r"array of shape \(..., 2\) with a, l", f, torch.ones(3))


TRUE = np.array([0.97, 2.93, 2.56, 3.04])
"""Lengths of crank, coupler, rocker and base of a four-bar, of which nominal values are 1, 3, 2.5 and 3 m."""
TURN = 0.5 + 2 * np.pi * np.linspace(0.0, 1.0, 25)


def coupler_curve():
    """A four-bar that a drive turns once, with the place of a point of its coupler."""
    machine = linkage(lambda m: mb.Motion("turn", m.crank.theta, 0.5 + 2 * np.pi * mb.t), lengths=(1.0, 3.0, 2.5, 3.0))
    point = machine.coupler.point(1.2 - machine.p.b / 2, 0.8)
    angles = {"crank.theta": 0.5, "coupler.theta": 0.7, "rocker.theta": 2.0}
    places = {"coupler.x": 2.0, "coupler.y": 1.4, "rocker.x": 2.5, "rocker.y": 1.1}
    return machine.scene({"x": point.x, "y": point.y}, np.linspace(0.0, 1.0, 25), guess=angles | places)


def curve_by_hand(lengths):
    """Places (25, 2) of the point by the intersection of two circles."""
    a, b, c, d = lengths
    B = a * np.exp(1j * TURN)
    to = d - B
    along = (b * b - c * c + abs(to) ** 2) / (2 * abs(to))
    axis = (along + 1j * np.sqrt(b * b - along**2)) * to / abs(to) / b
    point = B + (1.2 + 0.8j) * axis
    return np.stack([point.real, point.imag], 1)


def test_an_optimiser_of_jax_finds_lengths(jax):
    f, curve = mb.jax_function(coupler_curve(), [*"abcd"]), curve_by_hand(TRUE)
    np.testing.assert_allclose(f(TRUE), curve, atol=1e-6)
    loss = jax.jit(jax.value_and_grad(lambda u: ((f(u) - curve) ** 2).sum()))
    found = minimize(loss, [1.0, 3.0, 2.5, 3.0], jac=True, method="BFGS", options={"gtol": 1e-9})
    np.testing.assert_allclose(found.x, TRUE, atol=1e-6)


def test_an_optimiser_of_torch_finds_lengths():
    torch = pytest.importorskip("torch")
    f, curve = mb.torch_function(coupler_curve(), [*"abcd"]), torch.tensor(curve_by_hand(TRUE))
    u = torch.tensor([1.0, 3.0, 2.5, 3.0], dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.LBFGS([u], lr=1.0, max_iter=200, tolerance_grad=1e-10, tolerance_change=1e-14,
                                  line_search_fn="strong_wolfe")  # fmt: skip

    def closure():
        optimiser.zero_grad()
        loss = ((f(u) - curve) ** 2).sum()
        loss.backward()
        return loss

    optimiser.step(closure)
    np.testing.assert_allclose(u.detach(), TRUE, atol=1e-6)


def test_a_jump_at_an_output_time_is_told():
    times = np.linspace(0.0, 1.0, 5)
    scene = partial(particle, times=times, start={"mass.vx": 1.0}, outputs=("vx",), F=(1.0, 3.0), a=(0.0, 1.0))
    jump = scene(lambda p, mass: ca.if_else(mass.x > p.a, -p.F, 0))
    slopes = warned("respect to a are uncertain at 1 time, first at t = 0.5 s", mb.sensitivities, jump)
    late = times > 0.5  # v = 1 - F (t - a) after t = a
    np.testing.assert_allclose(slopes["vx", "a"][times != 0.5], 2.0 * late[times != 0.5], atol=1e-9)
    np.testing.assert_allclose(slopes["vx", "F"], [0, 0, 0, -0.25, -0.5], atol=1e-9)
    # v = cos(w t) with w^2 = F and x = a at t = a
    slopes = mb.sensitivities(scene(lambda p, mass: -p.F * ca.fmax(mass.x - p.a, 0)))
    w, late = np.sqrt(2.0), np.maximum(times - 0.5, 0.0)
    np.testing.assert_allclose(slopes["vx", "a"], w * np.sin(w * late), atol=1e-6)
    np.testing.assert_allclose(slopes["vx", "F"], -late * np.sin(w * late) / (2 * w), atol=1e-6)


def test_jax_passes_jumps_away_from_the_nominal_parameters(jax):
    law = lambda p, mass: ca.if_else(mass.x > p.a, -3.0, 0.0)  # noqa: E731
    f = mb.jax_function(particle(law, np.linspace(0.0, 0.25, 6), {"mass.vx": 1.5}, a=(0.3, 0.5)))
    last = jax.grad(lambda u: f(u)[-1, 0])
    assert last(np.array([0.39])) == 0.0  # the run ends before
    assert last(np.array([0.2])) == pytest.approx(2 * (0.25 - 0.2 / 1.5), abs=1e-9)


@pytest.mark.parametrize(("make", "package"), [(mb.jax_function, "jax"), (mb.torch_function, "torch")])
def test_second_derivatives_are_refused(make, package):
    package = pytest.importorskip(package)
    f = make(pendulum_on_a_spring())
    if make is mb.jax_function:
        of_pair, at = package.hessian(lambda u: f(u)[-1, 0]), POINTS[0]
    else:
        at = package.tensor(POINTS[0])
        of_pair = lambda u: package.autograd.functional.hessian(lambda u: f(u)[-1, 0], u)  # noqa: E731
    refused("symmb computes first derivatives of runs only", of_pair, at, error=mb.SimulationError)


@pytest.mark.parametrize("entry", [True, 1j, "text"])
def test_entries_that_are_no_real_numbers(entry):
    f = mb.jax_function(pendulum_on_a_spring()) if pytest.importorskip("jax") else None
    refused("jax_function: expected", f, [entry] * 3)
    torch = pytest.importorskip("torch")
    with pytest.raises(mb.DeclarationError, match="torch_function: expected a dense tensor of real numbers"):
        mb.torch_function(pendulum_on_a_spring())(torch.tensor([1]) if entry is True else [entry])


def test_sensitivities_of_a_function():
    box = mb.FunctionSimulator(lambda k: np.outer([1.0, 2.0], np.exp(k)), {"k": 1.5}, times=[0.0, 1.0], outputs=["y"])
    np.testing.assert_allclose(mb.sensitivities(box)["y", "k"], [np.exp(1.5), 2 * np.exp(1.5)], rtol=1e-9)


@pytest.mark.parametrize(("make", "package"), [(mb.jax_function, "jax"), (mb.torch_function, "torch")])
def test_what_gives_no_derivatives(make, package):
    package = pytest.importorskip(package)
    refused("lenght", make, coupler_curve(), ["lenght"])
    f, too_long = make(coupler_curve(), [*"abcd"]), [9.0, 1.0, 1.0, 1.0]
    with pytest.raises(Exception, match="the start could not be computed"):
        f(package.tensor(too_long) if make is mb.torch_function else np.array(too_long))


JET_TIMES = np.linspace(0.0, 0.8, 5)
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
        system, {"crank.theta": p.a, "crank.omega": 1 + p.a}, JET_TIMES, outputs,
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
    assert jets.shape == (order + 1, len(DIRECTIONS), len(JET_TIMES), 4)
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
    simulator = mb.DAESimulator(mb.Scene(system, start, JET_TIMES, outputs), mb.CVODES(rtol=1e-13))
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
