"""Forces of elements as outputs: what statics says of a body that hangs, lies or is held."""

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import GROUND, pendulum

import symmb as mb

WEIGHT = 2.0 * 9.81


def hanging(element_of):
    block = mb.Body("block", 2.0, 0.1, mb.Planar())
    element = element_of(block)
    guide = mb.Prismatic("guide", GROUND.point(0, 0), block.point(0, 0), axis=(0, 1, 0))
    return mb.System(block, guide, element, mb.Gravity(0, -9.81))


LAW = mb.KelvinVoigt(1e4, 10.0)
HELD = {
    "spring": lambda b: mb.Spring("it", GROUND.point(0, 1), b.point(0, 0), 500.0, 0.9),
    "strut": lambda b: mb.SpringDamper("it", GROUND.point(0, 1), b.point(0, 0), 500.0, 20.0, 0.9),
    "nonlinear": lambda b: mb.NonlinearSpring("it", GROUND.point(0, 1), b.point(0, 0), lambda d, v: 200 * (d - 0.9)),
    "rope": lambda b: mb.Rope("it", [GROUND.point(0, 1), b.point(0, 0)], 500.0, 0.9),
    "plane": lambda b: mb.Contact("it", b.point(0, 0), GROUND.point(0, 0), (0, 1), LAW),
    "circles": lambda b: mb.CircleContact("it", GROUND.point(0, -0.3), b.point(0, 0), 0.2, 0.1, LAW),
    "curve": lambda b: mb.CurveContact(
        "it", GROUND.point(0, -0.1), mb.Curve(lambda s: (s, s**2), -1, 1), b.point(0, 0), 0.1, LAW
    ),
}


@pytest.mark.parametrize("name", HELD)
def test_a_block_at_rest_is_held_by_its_weight(name):
    system = hanging(HELD[name])
    scene = mb.Scene(system, guess={"block.y": -1e-3}, outputs={"force": system.force("it")}, equilibrium=True)
    assert abs(mb.simulate(scene)["force"][0] / WEIGHT - 1) < 1e-9


def test_a_damper_brakes_with_its_force():
    system = hanging(lambda b: mb.Damper("it", GROUND.point(0, 1), b.point(0, 0), 3.0))
    scene = mb.Scene(system, {"block.vy": -2.0}, outputs={"force": system.force("it")})
    assert mb.simulate(scene)["force"] == pytest.approx([6.0])


def test_torques():
    """A rod of 1 m at rest on a torsion spring, and a motor that gives what its law says."""
    spring = lambda m: mb.TorsionSpring("spring", GROUND, m.rod, 200.0, 1.0)  # noqa: E731
    rod = pendulum(spring, lambda m: mb.Actuator("motor", m.hinge, 2 + 3 * mb.t), length=0.5, mass=2.0)
    outputs = {name: rod.system.force(name) for name in ("spring", "motor")} | {"angle": rod.hinge.angle}
    scene = rod.scene(outputs, equilibrium=True)
    run = mb.simulate(scene)
    assert scene.units[:2] == ("N m", "N m")
    assert run["motor"] == pytest.approx([2.0, 5.0])
    assert run["spring"][0] + 2.0 == pytest.approx(0.5 * WEIGHT * np.cos(run["angle"][0]))


def test_a_slack_rope_and_an_open_contact_have_none():
    system = hanging(lambda b: mb.Rope("it", [GROUND.point(0, 1), b.point(0, 0)], 500.0, 1.1))
    run = mb.simulate(mb.Scene(system, times=[0.0, 0.1], outputs={"force": system.force("it")}))
    np.testing.assert_array_equal(run["force"], 0.0)


def test_forces_that_are_no_number_are_refused():
    block = mb.Body("block", 2.0, 0.1, mb.Planar())
    push = mb.Force("push", block.point(0, 0), (ca.sin(mb.t), 0))
    brake = mb.Clutch("brake", GROUND, block, 1.0)
    system = mb.System(block, push, brake, mb.Spring("spring", GROUND.point(0, 1), block.point(0, 0), 1.0))
    for name in ("push", "spnig", 3):
        refused(r"no element with a force .*spring", system.force, name)
    refused(r"the force of 'brake' is a multiplier\. Use system\.lam\('brake'\)", system.force, "brake")
