"""Proved frequencies and damping against closed forms."""

import numpy as np
import pytest
from columns import ziegler
from faults import refused, warned
from machines import ball, spring_mass, wheel
from steady_scenes import conical_pendulum

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
    scene = spring_mass(mass=2.0, damping=1.0, stiffness=50.0).around(0.05)
    modal = mb.ModalSimulator(scene, count=1)
    m, k, c = corners_and_more(scene.box).T
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
    bounds = warned("frequencies may cross", mb.propagate, modal, mb.TaylorModel(ORDER))
    assert np.isinf(bounds.upper).all()
    bounds = mb.propagate(mb.ModalSimulator(particle(p.k, 111.0, 900.0, parameters=p)), mb.TaylorModel(ORDER))
    assert 2 * np.pi * bounds.lower[0, :3] == pytest.approx(np.sqrt([95.0, 111.0, 900.0]), rel=1e-8)
    assert 2 * np.pi * bounds.upper[0, :3] == pytest.approx(np.sqrt([105.0, 111.0, 900.0]), rel=1e-8)


def test_about_an_equilibrium_that_moves_with_the_parameters():
    """k x + c x^3 = m g holds a mass, and m omega^2 = k + 3 c x^2."""
    forces = lambda x, y, z, k: (-k * x - 30 * x**3, -700 * y, -900 * z)  # noqa: E731
    law = lambda m: mb.Force("spring", m.at, forces(m.ball.x, m.ball.y, m.ball.z, m.p.k))  # noqa: E731
    hanging = ball(law, mb.Gravity(9.81, 0, 0), mass=2.0, g=None, k=50.0)
    box = mb.Box.around(hanging.p, 0.1)
    modal = mb.ModalSimulator(mb.Scene(hanging.system, equilibrium=True, box=box), count=3)
    P = corners_and_more(box)
    x = np.array([max(np.roots([30, 0, k, -m * 9.81]), key=lambda root: -abs(root.imag)).real for m, k in P])
    exact = np.sqrt((P[:, 1] + 90 * x**2) / P[:, 0]) / (2 * np.pi)
    bounds = mb.propagate(modal, mb.TaylorModel(8))
    assert (exact >= bounds.lower[0, 0]).all() and (exact <= bounds.upper[0, 0]).all()
    assert np.ptp(exact) == pytest.approx(float(bounds.upper[0, 0] - bounds.lower[0, 0]), rel=1e-4)


def test_a_steady_motion_in_turning_coordinates_is_refused():
    """The Jacobian of its coordinates has other eigenvalues than the motion."""
    motion = conical_pendulum(np.random.default_rng(5))
    p = mb.Parameters(g=9.81)
    others = [element for element in motion.scene.system.elements if not isinstance(element, mb.Gravity)]
    system = mb.System(*others, mb.Gravity(0, 0, -p.g), parameters=p)
    scene = mb.Scene(system, motion.scene.start, guess=motion.scene.guess, box=mb.Box.around(p, 1e-3))
    own = mb.ModalSimulator(scene), mb.TaylorModel(3)
    refused("steady only in rotating coordinates", mb.propagate, *own, error=mb.PropagationError)


def test_a_buckling_load():
    """A rod on a spring that stiffens under a weight: theta = 0 is stable up to load = k - m g."""

    def spring(m):
        torque = (m.p.load - m.p.k + 2 * m.p.mass) * m.wheel.theta - m.wheel.theta**3 - m.wheel.omega
        return mb.Torque("spring", m.wheel, torque)

    limit = mb.critical(mb.Scene(wheel(spring, k=9.0, load=1.0).system), "load", (0.0, 20.0))
    bounds = mb.propagate(limit, mb.TaylorModel(3), mb.Box(k=(8.0, 10.0), mass=(0.9, 1.1)))
    assert 5.8 * (1 - 1e-7) < bounds.lower.item() <= 5.8
    assert 8.2 <= bounds.upper.item() < 8.2 * (1 + 1e-7)


@pytest.mark.parametrize("damping", [0.4, 0.0])
def test_flutter_of_two_rods_under_a_follower_force(damping):
    """Ziegler's column against the eigenvalues of its small angles; without damping two modes become one there."""
    column, exact = ziegler(np.random.default_rng(11), damping)
    box = mb.Box.around(column.system.parameters, 0.02, ["k"])
    limit = mb.critical(column, "F", (0.1, 60.0))
    if not damping:
        several = "several eigenvalues are imaginary or 0"
        refused(several, mb.propagate, limit, mb.TaylorModel(3), box, error=mb.PropagationError)
        return
    bounds = mb.propagate(limit, mb.TaylorModel(5), box)
    ends = [exact(value) for value in np.linspace(*box.bounds[0], 41)]
    assert [bounds.lower.item(), bounds.upper.item()] == pytest.approx([min(ends), max(ends)], rel=1e-7)
    assert bounds.lower.item() <= min(ends) + 1e-11
    assert bounds.upper.item() >= max(ends) - 1e-11


def two_rods():
    """One falls over at load = a, the other one begins to swing at load = b."""
    p = mb.Parameters(load=1.0, a=4.0, b=6.0)
    elements = []
    for name, stiffness, damping in (("falls", p.a - p.load, 1.0), ("swings", 50.0, p.b - p.load)):
        rod = mb.Body(name, mass=1.0, inertia=1.0)
        pin = mb.Revolute(f"pin_{name}", mb.Ground().point(0, 0), rod.point(0, 0))
        elements += [rod, pin, mb.Torque(f"torque_{name}", rod, -stiffness * rod.theta - damping * rod.omega)]
    return mb.critical(mb.Scene(mb.System(*elements, parameters=p)), "load", (0.0, 10.0))


def test_a_limit_that_another_one_precedes_in_a_part_of_the_box():
    limit = two_rods()
    wide, other = mb.Box(a=(3.5, 6.5), b=(3.0, 8.0)), r"at a = .*, b = .*, the limit of stability belongs to another"
    refused(other, mb.propagate, limit, mb.TaylorModel(3), wide, error=mb.PropagationError)
    for box, error in ((mb.Box(a=(3.5, 4.5), b=(5.0, 8.0)), 1e-6), (mb.Box(a=(4.5, 4.5)), 1e-9)):  # without width
        bounds = mb.propagate(limit, mb.TaylorModel(3), box)
        np.testing.assert_allclose([bounds.lower.item(), bounds.upper.item()], box["a"], rtol=error)
