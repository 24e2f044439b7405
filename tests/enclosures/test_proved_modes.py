"""Proved frequencies and damping against closed forms."""

import numpy as np
import pytest

import symmb as mb

ORDER = 5


def corners_and_more(box: mb.Box, n: int = 60) -> np.ndarray:
    """Random points and corners of a box (2 n, d)."""
    rng, d = np.random.default_rng(0), len(box)
    return box.from_unit(np.vstack([rng.uniform(-1, 1, (n, d)), rng.choice([-1, 1], (n, d))]))


def require_tight(bounds: mb.Bounds, exact: np.ndarray, absolute: float = 0.0) -> None:
    """Exact values (N, n_y), those at corners among them, are inside of bounds that are hardly wider."""
    lower, upper = bounds.lower[0], bounds.upper[0]
    assert (exact >= lower).all() and (exact <= upper).all()
    assert np.ptp(exact, axis=0) == pytest.approx(upper - lower, rel=1e-5, abs=absolute)


def test_a_damped_oscillator():
    p = mb.Parameters(m=2.0, c=1.0, k=50.0)
    mass = mb.Body("mass", mass=p.m, pose=mb.Particle())
    force = mb.Force("force", mass.point(0, 0, 0), (-p.k * mass.x - p.c * mass.vx, 0, 0))
    box = mb.Box.around(p, 0.05)
    modal = mb.ModalSimulator(mb.Scene(mb.System(mass, force, parameters=p), box=box), count=1)
    m, c, k = corners_and_more(box).T
    exact = np.stack([np.sqrt(k / m) / (2 * np.pi), c / (2 * np.sqrt(k * m))], axis=1)
    require_tight(mb.propagate(modal, mb.TaylorModel(ORDER)), exact)


def test_a_parallelogram_of_rods_that_carries_a_plate():
    """The plate of mass M does not turn: omega^2 = g / l (m + M) / (2 m / 3 + M)."""
    p, ground = mb.Parameters(l=1.0, m=1.0), mb.Ground()
    rods = [mb.Body(f"rod{i}", mass=p.m, inertia=p.m * p.l**2 / 12, pose=mb.Planar()) for i in (0, 1)]
    plate = mb.Body("plate", mass=2.0, inertia=0.3, pose=mb.Planar())
    elements = [*rods, plate, mb.Gravity(0, -9.81)]
    for rod, x in zip(rods, (-0.35, 0.35), strict=True):
        elements.append(mb.Revolute(f"upper_{rod.name}", ground.point(x, 0), rod.point(0, p.l / 2)))
        elements.append(mb.Revolute(f"lower_{rod.name}", rod.point(0, -p.l / 2), plate.point(x, 0)))
    start = {"rod0.x": -0.35, "rod0.y": -p.l / 2, "rod1.x": 0.35, "rod1.y": -p.l / 2, "plate.y": -p.l}
    box = mb.Box.around(p, 0.1)
    modal = mb.ModalSimulator(mb.Scene(mb.System(*elements, parameters=p), start=start, box=box))
    length, m = corners_and_more(box).T
    exact = np.sqrt(9.81 / length * (m + 2) / (2 * m / 3 + 2)) / (2 * np.pi)
    bounds = mb.propagate(modal, mb.TaylorModel(ORDER))
    require_tight(bounds, np.stack([exact, 0 * exact], axis=1), absolute=1e-12)


def particle(*stiffnesses: object, parameters: mb.Parameters) -> mb.Scene:
    mass = mb.Body("mass", mass=1.0, pose=mb.Particle())
    x = mass.x, mass.y, mass.z
    spring = mb.Force("spring", mass.point(0, 0, 0), [-k * part for k, part in zip(stiffnesses, x, strict=True)])
    return mb.Scene(mb.System(mass, spring, parameters=parameters), box=mb.Box.around(parameters, 0.05))


def test_frequencies_that_cross_are_not_proved():
    p = mb.Parameters(k=100.0)
    modal = mb.ModalSimulator(particle(p.k, 101.0, 900.0, parameters=p))
    with pytest.warns(mb.SymmbWarning, match="frequencies may cross"):
        bounds = mb.propagate(modal, mb.TaylorModel(ORDER))
    assert np.isinf(bounds.upper).all()
    bounds = mb.propagate(mb.ModalSimulator(particle(p.k, 111.0, 900.0, parameters=p)), mb.TaylorModel(ORDER))
    assert 2 * np.pi * bounds.lower[0, :3] == pytest.approx(np.sqrt([95.0, 111.0, 900.0]), rel=1e-8)
    assert 2 * np.pi * bounds.upper[0, :3] == pytest.approx(np.sqrt([105.0, 111.0, 900.0]), rel=1e-8)


def test_about_an_equilibrium_that_moves_with_the_parameters():
    """k x + c x^3 = m g holds a mass, and m omega^2 = k + 3 c x^2."""
    p = mb.Parameters(m=2.0, k=50.0)
    mass = mb.Body("mass", mass=p.m, pose=mb.Particle())
    spring = mb.Force("spring", mass.point(0, 0, 0), (-p.k * mass.x - 30 * mass.x**3, -700 * mass.y, -900 * mass.z))
    system = mb.System(mass, spring, mb.Gravity(9.81, 0, 0), parameters=p)
    box = mb.Box.around(p, 0.1)
    modal = mb.ModalSimulator(mb.Scene(system, equilibrium=True, box=box), count=3)
    P = corners_and_more(box)
    x = np.array([max(np.roots([30, 0, k, -m * 9.81]), key=lambda root: -abs(root.imag)).real for m, k in P])
    exact = np.sqrt((P[:, 1] + 90 * x**2) / P[:, 0]) / (2 * np.pi)
    bounds = mb.propagate(modal, mb.TaylorModel(8))
    assert (exact >= bounds.lower[0, 0]).all() and (exact <= bounds.upper[0, 0]).all()
    assert np.ptp(exact) == pytest.approx(float(bounds.upper[0, 0] - bounds.lower[0, 0]), rel=1e-4)
