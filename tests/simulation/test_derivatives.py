"""Gradients of runs by JAX and PyTorch, against complex steps through equations by hand and closed forms."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from faults import refused
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from small_scenes import particle

import symmb as mb

TIGHT = mb.DormandPrince(rtol=1e-12, atol=1e-13)
TIMES = np.linspace(0.0, 1.0, 6)
POINTS = np.array([[0.9, 0.5, 0.3], [1.1, 0.4, -0.2], [1.0, 0.7, 0.6], [1.3, 0.2, 1.0]])


def pendulum_on_a_spring():
    """A mass on a spring of length l about a pivot, with parameters l, the damping c and the angle a at the start."""
    p = mb.Parameters(l=1.0, c=0.5, a=0.3)
    bob = mb.Body("bob", mass=1.0, pose=mb.Particle())
    spring = mb.SpringDamper("spring", mb.Ground().point(0, 0), bob.point(0, 0), 50.0, p.c, p.l)
    start = {"bob.x": p.a, "bob.y": -p.l}
    system = mb.System(bob, spring, mb.Gravity(0, -9.81), parameters=p)
    return mb.Scene(system, start, TIMES, {"x": bob.x, "y": bob.y, "vx": bob.vx})


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


def test_jax_has_values_and_gradients_of_batches():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
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
    p = mb.Parameters(crank=1.0, coupler=3.0, rocker=2.5, base=3.0)
    crank, coupler, rocker = (mb.Body(name, 1.0, 0.1, mb.Planar()) for name in ("a", "b", "c"))
    ground = mb.Ground()
    system = mb.System(
        crank, coupler, rocker,
        mb.Revolute("A", ground.point(0, 0), crank.point(0, 0)),
        mb.Revolute("B", crank.point(p.crank, 0), coupler.point(0, 0)),
        mb.Revolute("C", coupler.point(p.coupler, 0), rocker.point(p.rocker, 0)),
        mb.Revolute("D", ground.point(p.base, 0), rocker.point(0, 0)),
        mb.Motion("turn", crank.theta, 0.5 + 2 * np.pi * mb.t),
        parameters=p,
    )  # fmt: skip
    point = coupler.point(1.2, 0.8)
    guess = {"a.theta": 0.5, "b.theta": 0.7, "c.theta": 2.0, "b.x": 0.9, "b.y": 0.5, "c.x": 3.0}
    return mb.Scene(system, times=np.linspace(0.0, 1.0, 25), outputs={"x": point.x, "y": point.y}, guess=guess)


def curve_by_hand(lengths):
    """Places (25, 2) of the point by the intersection of two circles."""
    a, b, c, d = lengths
    B = a * np.exp(1j * TURN)
    to = d - B
    along = (b * b - c * c + abs(to) ** 2) / (2 * abs(to))
    axis = (along + 1j * np.sqrt(b * b - along**2)) * to / abs(to) / b
    point = B + (1.2 + 0.8j) * axis
    return np.stack([point.real, point.imag], 1)


def test_an_optimiser_of_jax_finds_lengths():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    f, curve = mb.jax_function(coupler_curve()), curve_by_hand(TRUE)
    np.testing.assert_allclose(f(TRUE), curve, atol=1e-6)
    loss = jax.jit(jax.value_and_grad(lambda u: ((f(u) - curve) ** 2).sum()))
    found = minimize(loss, [1.0, 3.0, 2.5, 3.0], jac=True, method="BFGS", options={"gtol": 1e-9})
    np.testing.assert_allclose(found.x, TRUE, atol=1e-6)


def test_an_optimiser_of_torch_finds_lengths():
    torch = pytest.importorskip("torch")
    f, curve = mb.torch_function(coupler_curve()), torch.tensor(curve_by_hand(TRUE))
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
    with pytest.warns(mb.SymmbWarning, match="respect to a are uncertain at 1 time, first at t = 0.5 s"):
        slopes = mb.sensitivities(scene(lambda p, mass: ca.if_else(mass.x > p.a, -p.F, 0)))
    late = times > 0.5  # v = 1 - F (t - a) after t = a
    np.testing.assert_allclose(slopes["vx", "a"][times != 0.5], 2.0 * late[times != 0.5], atol=1e-9)
    np.testing.assert_allclose(slopes["vx", "F"], [0, 0, 0, -0.25, -0.5], atol=1e-9)
    # v = cos(w t) with w^2 = F and x = a at t = a
    slopes = mb.sensitivities(scene(lambda p, mass: -p.F * ca.fmax(mass.x - p.a, 0)))
    w, late = np.sqrt(2.0), np.maximum(times - 0.5, 0.0)
    np.testing.assert_allclose(slopes["vx", "a"], w * np.sin(w * late), atol=1e-6)
    np.testing.assert_allclose(slopes["vx", "F"], -late * np.sin(w * late) / (2 * w), atol=1e-6)


def test_jax_passes_jumps_away_from_the_nominal_parameters():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
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
    f, too_long = make(coupler_curve()), [9.0, 1.0, 1.0, 1.0]
    with pytest.raises(Exception, match="the start could not be computed"):
        f(package.tensor(too_long) if make is mb.torch_function else np.array(too_long))
