"""Starts in static equilibrium against closed forms."""

import casadi as ca
import machines
import numpy as np
import pytest
from faults import refused

import symmb as mb

G = 9.81


def pendulum(**options) -> mb.Scene:
    """A rod pushed sideways at its end: tan(theta) = 2 F / (m g), for theta from the downward vertical."""
    push = lambda m: mb.Force("push", m.rod.point(m.p.length, 0), (m.p.push, 0))  # noqa: E731
    rod = machines.pendulum(push, length=0.5, mass=2.0, push=3.0)
    outputs = {"theta": rod.body.theta + np.pi / 2}
    return rod.scene(outputs, np.linspace(0.0, 1.0, 11), box=mb.Box(push=(1.0, 6.0)), equilibrium=True, **options)


def angle(push: float) -> float:
    return float(np.arctan(2 * push / (2.0 * G)))


def test_a_pushed_pendulum_stays_where_forces_balance():
    assert mb.simulate(pendulum())["theta"] == pytest.approx(np.full(11, angle(3.0)), abs=1e-9)


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.CVODES()], ids=repr)
def test_every_sample_has_its_own_equilibrium(solver):
    bounds = mb.propagate(pendulum(), mb.Scanning(3), solver=solver)
    assert bounds.lower[:, 0] == pytest.approx(np.full(11, angle(1.0)), abs=1e-8)
    assert bounds.upper[:, 0] == pytest.approx(np.full(11, angle(6.0)), abs=1e-8)


def test_taylor_follows_the_equilibrium():
    """The second-order expansion of the angle about 3.5 N, at the ends of the box."""
    bounds = mb.propagate(pendulum(), mb.Taylor(order=2), mb.Box(push=(2.9, 3.1)))
    c = 1 / G
    first, second = c / (1 + (3 * c) ** 2), -2 * c**2 * (3 * c) / (1 + (3 * c) ** 2) ** 2 / 2
    assert bounds.lower[0, 0] == pytest.approx(angle(3.0) - 0.1 * first + second * 0.01, abs=1e-6)


def test_a_wrong_guess_settles_as_a_pendulum_in_honey():
    scene = pendulum(guess={"rod.theta": 2.9 - np.pi / 2})
    assert mb.simulate(scene)["theta"][0] % (2 * np.pi) == pytest.approx(angle(3.0), abs=1e-9)


def test_a_cantilever_sags_by_its_own_weight():
    """w = rho A g L^4 / (8 E I), all that the modes of one clamped end can show."""
    steel, section, length = mb.Material(E=2.1e11, nu=0.3, density=7850), mb.Section.circle(0.01).without_shear(), 1.0
    line = mb.Beam([(0, 0, 0), (length, 0, 0)], section, steel, elements=10)
    modes = mb.FiniteElements.beams(line).modes(count=8, clamped=0, planar=True)
    beam = mb.FlexibleBody("beam", modes, mb.Planar())
    system = mb.System(beam, mb.Weld("wall", mb.Ground().point(0, 0), beam.point(0, 0)), mb.Gravity(0, -G))
    scene = mb.Scene(system, times=[0.0, 0.01], outputs={"y": beam.point(length, 0).y}, equilibrium=True)
    sag = steel.density * section.area * G * length**4 / (8 * steel.E * section.Iz)
    assert mb.simulate(scene)["y"] == pytest.approx(np.full(2, -sag), rel=1e-4)


def test_reactions_in_equilibrium_carry_the_weight():
    scene = pendulum()
    reaction = scene.system.reaction("hinge")
    run = mb.simulate(scene.with_outputs({"fx": reaction.fx, "fy": reaction.fy}))
    assert run["fx"][0] == pytest.approx(-3.0, abs=1e-9)
    assert run["fy"][0] == pytest.approx(2.0 * G, abs=1e-9)


def test_listed_coordinates_are_held_against_all_forces():
    assert mb.simulate(pendulum(start={"rod.theta": -0.5}))["rod.theta"][0] == -0.5


def test_a_contact_carries_a_block():
    """The penetration at which k d^1.5 is the weight, from a start above the ground."""
    law = mb.HuntCrossley(stiffness=1e7, restitution=0.5, speed=1.0)
    block = machines.ball(lambda m: mb.Contact("foot", m.at, machines.ORIGIN, (0, 1, 0), law), mass=3.0)
    run = block.run("y", [0.0, 0.1], guess={"ball.y": 0.01}, equilibrium=True)
    assert run["y"] == pytest.approx(np.full(2, -((3.0 * G / 1e7) ** (2 / 3))), abs=1e-10)


def test_what_no_force_opposes_is_named():
    scene = machines.cart(mb.Gravity(0, -G)).scene(equilibrium=True)
    refused(r"no force opposes cart\.x", mb.simulate, scene, error=mb.AssemblyError)


def test_without_equilibrium_the_fault_is_told():
    ball = machines.ball(lambda m: mb.Force("f", m.at, (ca.sin(m.ball.x), 0)))
    refused("No static equilibrium", mb.simulate, ball.scene(equilibrium=True), error=mb.AssemblyError)


# Values at the start of a run: kept along it, for every sample, and followed by Taylor's method.


def hanging() -> mb.Scene:
    """A mass on a spring in equilibrium at -m g / k, which a force pulls from 0 on: F/k (1 - cos) more."""
    spring = lambda m: mb.Spring("spring", machines.ORIGIN, m.at, m.p.stiffness)  # noqa: E731
    pull = lambda m: mb.Force("pull", m.at, (0, -3.0 * mb.Table([0.0, 1e-9], [0.0, 1.0])(mb.t)))  # noqa: E731
    block = machines.ball(spring, pull, mass=2.0, stiffness=40.0)
    outputs = {"way": block.body.y - mb.initial(block.body.y), "start": mb.initial(block.body.y)}
    return block.scene(outputs, np.linspace(0.0, 1.0, 11), box=mb.Box(stiffness=(36.0, 44.0)), equilibrium=True)


@pytest.mark.parametrize("solver", [mb.DormandPrince(), mb.CVODES()], ids=repr)
def test_every_sample_keeps_its_own(solver):
    scene = hanging()
    Y = mb.DAESimulator(scene, solver).run(np.array([[2.0, G, 36.0], [2.0, G, 44.0]])).Y
    for values, k in zip(Y, (36.0, 44.0), strict=True):
        way = -3.0 / k * (1 - np.cos(np.sqrt(k / 2.0) * scene.times))
        assert values[:, 0] == pytest.approx(way, abs=1e-7)
        assert values[:, 1] == pytest.approx(np.full(11, -2.0 * G / k), abs=1e-9)


def test_taylor_follows_it():
    low, high = mb.propagate(hanging(), mb.Taylor(order=4))["start"]
    assert low == pytest.approx(np.full(11, -2.0 * G / 36.0), rel=1e-3)
    assert high == pytest.approx(np.full(11, -2.0 * G / 44.0), rel=2e-2)  # even powers count from 0


def test_what_has_no_start_to_be_kept_is_refused():
    block = mb.Body("block", mass=2.0, pose=mb.Particle())
    for expression in (block.vy, block.y * mb.t, 0 * block.y):
        refused("coordinates and parameters only", mb.initial, expression)
