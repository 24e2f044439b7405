"""Frequencies over boxes against closed forms."""

import numpy as np
import pytest
from faults import refused
from small_scenes import particle, two_masses

import symmb as mb


def coupled(coupling: float) -> mb.Scene:
    """Two oscillators of 1 kg whose stiffnesses cross inside the box, with a spring between them [N/m]."""

    def law(p, a, b):
        pull = coupling * (a.x - b.x)
        return (-p.k1 * a.x - pull, 0, 0), (-p.k2 * b.x + pull, 0, 0)

    return two_masses(law, box=mb.Box(k1=(90.0, 110.0), k2=(93.6, 114.4)), k1=100.0, k2=104.0)


def frequencies(P: np.ndarray, coupling: float) -> np.ndarray:
    """Both [Hz], the lower one first, (N, 2)."""
    mean, half = P.mean(axis=1) + coupling, np.hypot((P[:, 0] - P[:, 1]) / 2, coupling)
    return np.sqrt(np.stack([mean - half, mean + half], axis=1)) / (2 * np.pi)


def test_modes_that_cross_keep_their_numbers_and_this_is_told():
    scene = coupled(0.0)
    modal = mb.ModalSimulator(scene, count=2)
    P = np.array([[100.0, 104.0], [109.0, 95.0], [95.0, 110.0]])
    np.testing.assert_allclose(modal.run(P).Y[:, 0, :2], np.sqrt(P) / (2 * np.pi), rtol=1e-12)
    (told,) = modal.crossings(scene.box)
    assert told.startswith("f1 and f2 cross between k1 = 100, k2 = 104 and k1 = ")
    bounds = mb.propagate(modal, mb.PolynomialChaos(), box=scene.box)
    ends = np.sqrt([[90, 93.6], [110, 114.4]]) / (2 * np.pi)
    width = ends[1] - ends[0]
    assert (np.abs(bounds.lower[0, :2] - ends[0]) < 1e-3 * width).all()
    assert (np.abs(bounds.upper[0, :2] - ends[1]) < 1e-3 * width).all()


@pytest.mark.parametrize("coupling", [0.3, 1.0, 5.0])
def test_modes_that_veer_do_not_cross(coupling):
    scene = coupled(coupling)
    modal = mb.ModalSimulator(scene, count=2)
    P = np.random.default_rng(5).uniform(scene.box.lower, scene.box.upper, (60, 2))
    np.testing.assert_allclose(modal.run(P).Y[:, 0, :2], frequencies(P, coupling), rtol=1e-12)
    assert not modal.crossings(scene.box)


@pytest.mark.parametrize("coupling", [pytest.param(0.3, marks=pytest.mark.long), 1.0, 5.0])
def test_bounds_of_modes_that_veer(coupling):
    scene = coupled(coupling)
    bounds = mb.propagate(mb.ModalSimulator(scene, count=2), mb.PolynomialChaos(tolerance=1e-3), box=scene.box)
    grid = np.stack(np.meshgrid(*[np.linspace(*ends, 401) for ends in scene.box.bounds]), axis=-1).reshape(-1, 2)
    exact = frequencies(grid, coupling)
    width = np.ptp(exact, axis=0)
    assert (np.abs(bounds.lower[0, :2] - exact.min(axis=0)) < 2e-3 * width).all()
    assert (np.abs(bounds.upper[0, :2] - exact.max(axis=0)) < 2e-3 * width).all()


def test_damping_and_a_mode_that_ends():
    law = lambda p, mass: (-p.k * mass.x - p.c * mass.vx, 0, 0)  # noqa: E731
    modal = mb.ModalSimulator(particle(law, [0.0], {}, c=(0.1, 0.3), k=(3.0, 5.0)))
    assert modal.outputs == ("f1", "zeta1")
    assert modal.units == ("Hz", "1")
    samples = modal.run(np.array([[0.2, 4.0], [1.0, 9.0], [5.0, 4.0]]))
    np.testing.assert_allclose(samples.Y[:2, 0], [[2 / (2 * np.pi), 0.05], [3 / (2 * np.pi), 1 / 6]], rtol=1e-12)
    assert samples.ok.tolist() == [True, True, False]
    assert "mode 1 does not oscillate at these parameters" in samples.messages[0]


def test_a_swing_is_doubtful():
    rod = mb.Body("rod", mass=3.0, inertia=1.0)
    pin = mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(0, 1))
    with pytest.warns(mb.SymmbWarning, match="neither an equilibrium nor a steady motion"):
        mb.ModalSimulator(mb.Scene(mb.System(rod, pin, mb.Gravity(0, -9.81)), {"rod.theta": 0.7}))


def test_faults():
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    refused("has no oscillation", mb.ModalSimulator, mb.Scene(mb.System(mass, mb.Gravity(0, 0, -9.81))))
    refused("count must be an integer of at least 1", mb.ModalSimulator, coupled(0.0), 0)
    refused("Expected a Scene, got System", mb.ModalSimulator, coupled(0.0).system)


def test_the_box_of_the_scene_is_taken():
    force = lambda p, mass: (-p.k * mass.x - p.c * mass.vx, 0, 0)  # noqa: E731
    scene = particle(force, [0.0], {}, k=(81.0, 121.0), c=(-1.0, 1.0))
    bounds = mb.propagate(mb.ModalSimulator(scene), mb.Vertex())
    assert 2 * np.pi * np.ravel(bounds["f1"]) == pytest.approx([9.0, 11.0])
    assert mb.critical(scene, "c", (-1.0, 1.5)).box == mb.Box(k=(81.0, 121.0))
