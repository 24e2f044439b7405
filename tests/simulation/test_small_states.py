"""States that are smaller than their absolute tolerances, and decide on others."""

import numpy as np
import pytest
from faults import warned
from machines import spring_mass
from numpy.testing import assert_allclose

import symmb as mb


def reaction(A, B, C, M, end, times=(10.0, 1e3)):
    """Problem E5 of the test set for initial value problems, as velocities of a particle: x, y, z are species."""
    species = mb.Body("s", 1.0, pose=mb.Particle())
    y1, y2, y3 = species.x, species.y, species.z
    rates = -A * y1 - B * y1 * y3, A * y1 - M * C * y2 * y3, A * y1 - B * y1 * y3 - M * C * y2 * y3 + C * (y2 - y3)
    velocities = zip("uvw", (species.vx, species.vy, species.vz), rates, strict=True)
    rows = [mb.VelocityConstraint(name, (v - rate,)) for name, v, rate in velocities]
    start = {"s.x": 1.76e-3, "s.y": 0.0, "s.z": 0.0}
    return mb.Scene(mb.System(species, *rows), start, [0.0, *times, end], {"y1": y1})


@pytest.mark.parametrize(("A", "B", "right"), [(7.89e-10, 1.1e7, 4.715e-10), (9e-10, 0.9e7, None)])
def test_a_reaction_with_species_that_are_rounding_beside_others_is_doubted(A, B, right):
    told = r"Output 'y1' depends on states that are smaller than their absolute tol"
    warned(told, mb.simulate, reaction(A, B, 1.13e3, 1e6, 1e7))
    assert mb.simulate(reaction(A, B, 1.13e3, 1e6, 1e5, (1.0, 10.0)))["y1"][-1] > 0
    if right is not None:
        fine = mb.simulate(reaction(A, B, 1.13e3, 1e6, 1e7), mb.CVODES(stiff=True, atol=1e-24))
        assert_allclose(fine["y1"][-1], right, rtol=0.05)


def test_small_states_that_follow_others_are_not_doubted():
    """A filter of a signal of 1e-13 beside a motion of 1 m, and one that dies away."""
    fades = mb.State("fades", rate=lambda z: -z / 0.01)
    machine = spring_mass(lambda m: mb.State("small", rate=lambda z: (1e-13 * m.ball.x - z) / 0.1), fades, stiffness=40)
    start, outputs = {"ball.x": 1.0, "small": 0.0, "fades": 1.0}, {"small": machine.small.value, "x": machine.ball.x}
    assert not machine.run(outputs, np.linspace(0, 1, 11), start, solver=mb.CVODES(rtol=1e-6)).doubts


def test_outputs_below_all_tolerances_are_not_doubted():
    """As velocities of 1e-33 m/s that rounding makes of a body that falls."""
    scene = reaction(7.89e-10, 1.1e7, 1.13e3, 1e6, 1e7)
    assert not mb.simulate(scene, outputs={"shade": 1e-27 * scene.system.bodies[0].x}).doubts
