"""Linearisations of steady motions in closed form, of states that are none, and of coordinates that nothing touches."""

import warnings
from functools import cache

import numpy as np
import pytest
from steady_scenes import GROUND, SteadyMotion, random_motions

import symmb as mb


@cache
def motions() -> list[SteadyMotion]:
    return [motion for seed in (1, 2) for motion in random_motions(seed)]


@pytest.mark.parametrize("number", range(2 * 8))
def test_eigenvalues_in_closed_form(number: int) -> None:
    motion = motions()[number]
    with warnings.catch_warnings(action="ignore"):
        lin = mb.linearize(motion.scene)
    assert bool(lin.doubts) is not motion.steady
    for value in motion.eigenvalues if motion.steady else ():
        assert np.abs(lin.eigenvalues - value).min() < 1e-6 * abs(value)


def test_growth_is_what_the_closed_form_says() -> None:
    for motion in motions():
        if motion.name == "rolling disc":
            grows = motion.eigenvalues.real.max() > 0
            assert (mb.linearize(motion.scene).stability == "unstable") == grows


def test_critical_speed_of_a_rolling_disc() -> None:
    p = mb.Parameters(w=0.0)
    motion = next(random_motions(3))
    start = {**motion.scene.start, "disc.omega": (0.0, 0.0, p.w)}
    system = motion.scene.system.with_elements((), p)
    scene = mb.Scene(system, start, [0.0, 1.0], guess=motion.scene.guess)
    A = system.M[3, 3]
    disc = float(A)
    mass, R = float(system.M[0, 0]), float(motion.scene.guess["disc.z"])
    expected = np.sqrt(disc * mass * 9.81 * R / (2 * disc * (2 * disc + mass * R * R)))
    found = mb.critical(scene, "w", (0.2 * expected, 3 * expected)).run(np.zeros((1, 0))).Y.ravel()
    assert found == pytest.approx([expected], rel=1e-6)


@pytest.mark.parametrize("gravity", [False, True])
@pytest.mark.parametrize("time", [0.0, 0.7])
def test_a_particle_that_nothing_touches_is_a_state_of_the_outputs(gravity: bool, time: float) -> None:
    a, b = (mb.Body(name, 1.0, pose=mb.Particle()) for name in "ab")
    elements = [a, b, mb.Spring("s", GROUND.point(0, 0), a.point(0, 0), 4.0)]
    elements += [mb.Gravity(0, -9.81)] if gravity else []
    outputs = {"x": b.x, "both": b.x * b.z + 3 * b.vx + a.x}
    start = {"b.vx": 1.5, "a.x": 0.1, "b.x": 0.2, "b.z": 0.4, "b.vz": 0.3}
    run = mb.simulate(mb.Scene(mb.System(*elements), start, [0.0, 0.7], outputs))
    with warnings.catch_warnings(action="ignore"):
        lin = mb.linearize(run, time)
    x, z = 0.2 + 1.5 * time, 0.4 + 0.3 * time
    expected = {"b.x": (1.0, z), "b.z": (0.0, x), "b.vx": (0.0, 3.0), "b.vz": (0.0, 0.0), "a.x": (0.0, 1.0)}
    for name, column in expected.items():
        assert lin.C[:, lin.states.index(name)] == pytest.approx(column)
    i, j = lin.states.index("b.x"), lin.states.index("b.vx")
    assert np.flatnonzero(lin.A[i]).tolist() == [j] and not lin.A[j].any()
