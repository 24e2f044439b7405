"""What is doubtful about a start is told in sentences."""

import numpy as np
import pytest
from faults import warned
from machines import GROUND, ball, bouncing_ball, pendulum, rods

import symmb as mb
from symmb.run.events import event_doubts

TIMES = np.linspace(0.0, 2.0, 5)


def doubts(scene):
    return mb.DAESimulator(scene, mb.DormandPrince()).start.doubts


@pytest.mark.parametrize(
    ("angle", "is_doubtful"), [(np.pi / 2, True), (-np.pi / 2, False), (1.4, False), (np.pi / 2 - 1e-3, False)]
)
def test_a_rod_upright_is_an_unstable_equilibrium(angle, is_doubtful):
    found = doubts(pendulum().scene(None, TIMES, {"rod.theta": angle}))
    assert len(found) == is_doubtful and all("unstable equilibrium" in text for text in found)


def test_what_moves_or_has_no_weight_is_in_no_unstable_equilibrium():
    assert doubts(pendulum().scene(None, TIMES, {"rod.theta": np.pi / 2, "rod.omega": 1e-3})) == ()
    assert doubts(pendulum(g=0.0).scene(None, TIMES, {"rod.theta": np.pi / 2})) == ()


@pytest.mark.parametrize("guess", [np.pi / 2, 0.9])
def test_an_equilibrium_that_is_solved_for_may_be_unstable(guess):
    """From upright nothing leads away; from elsewhere the rod settles hanging."""
    place = {"rod.theta": guess, "rod.x": np.cos(guess), "rod.y": np.sin(guess)}
    assert len(doubts(pendulum().scene(times=TIMES, guess=place, equilibrium=True))) == (guess == np.pi / 2)


@pytest.mark.parametrize(("load", "is_doubtful"), [(0.9, False), (1.1, True)])
def test_a_column_buckles_above_its_critical_load(load, is_doubtful):
    """A rigid column of length l on a torsion spring c: the critical load is c / l."""
    spring = lambda m: mb.TorsionSpring("spring", GROUND, m.rod, 30.0)  # noqa: E731
    push = lambda m: mb.Force("load", m.rod.point(1, 0), (-m.p.load * 30.0 / 2, 0))  # noqa: E731
    column = pendulum(spring, push, g=None, load=load)
    assert len(doubts(column.scene(times=TIMES))) == is_doubtful


def test_locked_mechanisms_are_doubtful_and_driven_or_welded_ones_are_not():
    closed = rods(2, lambda m: mb.Revolute("C", GROUND.point(1.2, 0.9), m.rod1.point(0, -0.5)))
    (told,) = doubts(closed.scene(times=TIMES, guess={"rod1.theta": 2.57}))
    assert "locked: its constraints leave none of its 6 velocities" in told
    a = mb.Body("a", 1.0, 0.1)
    assert doubts(pendulum(lambda m: mb.Motion("drive", m.rod.theta, mb.t), g=None).scene(times=TIMES)) == ()
    assert doubts(mb.Scene(mb.System(a, mb.Weld("A", GROUND.point(0, 0), a.point(0, 0))), times=TIMES)) == ()
    assert doubts(pendulum(g=None).scene(None, TIMES, {"rod.theta": 0.1})) == ()


@pytest.mark.parametrize(("e", "masses", "is_doubtful"), [(0.5, 1.0, True), (1.0, 1.0, False), (1.0, 2.0, True)])
def test_impacts_of_one_instant_are_doubtful_if_their_order_matters(e, masses, is_doubtful):
    """Two balls hit a third one from both sides. Equal elastic balls exchange velocities, in whatever order."""
    balls = [mb.Body(name, m, pose=mb.Particle()) for name, m in zip("abc", (1.0, masses, 1.0), strict=True)]
    pairs = (("left", *balls[:2]), ("right", *balls[1:]))
    contacts = [mb.Impact(name, right.x - left.x - 1, e) for name, left, right in pairs]
    scene = mb.Scene(mb.System(*balls, *contacts), {"a.x": -2.0, "a.vx": 1.0, "c.x": 2.0, "c.vx": -1.0}, TIMES)
    told = "impacts of 'left', 'right' at t = 1 s are simultaneous"
    run = warned(told, mb.simulate, scene) if is_doubtful else mb.simulate(scene)
    assert event_doubts(run.events) == run.doubts and bool(run.doubts) == is_doubtful


def test_impacts_of_one_instant_that_have_nothing_to_do_with_each_other_are_not_doubtful():
    other = mb.Body("other", 1.0, pose=mb.Particle())
    pair = bouncing_ball(other, mb.Impact("other_floor", other.y, 0.5))
    run = pair.run(None, TIMES[:3], {"ball.y": 1.0, "other.y": 1.0})
    assert len(run.events) >= 2 and event_doubts(run.events) == ()


@pytest.mark.parametrize("axis", [(1, 0, 0), (1, 2, 0), (0.3, -1, 2)])
def test_a_particle_on_a_rail_is_not_locked(axis):
    """Along x nothing acts on it: the coordinate leaves the state, but it is free."""
    rail = lambda m: mb.PointOnLine("rail", GROUND.point(0, 0), m.at, axis=axis)  # noqa: E731
    assert doubts(ball(rail).scene(times=TIMES)) == ()
    (text,) = doubts(ball(lambda m: mb.Spherical("pin", GROUND.point(0, 0), m.at)).scene(times=TIMES))
    assert "locked" in text


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("axis", [(0, 0, 1), (0.6, 0, 0.8)])
def test_a_door_that_balances_everywhere_is_neutral(count, axis):
    """Gravity along the hinges, of which all but one are redundant: the door stays where it is put."""
    leaf = mb.Body("leaf", 20.0, (4.0, 1.0, 3.0), mb.Spatial(), com=(0.4, 0.1, 0.9))
    places = [[k * c for c in axis] for k in range(count)]
    hinges = [mb.Revolute(f"h{k}", GROUND.point(*at), leaf.point(*at), axis=axis) for k, at in enumerate(places)]
    assert doubts(mb.Scene(mb.System(leaf, *hinges, mb.Gravity(*(-9.81 * c for c in axis))), times=TIMES)) == ()


def gate():
    leaf = mb.Body("gate", 20.0, 4.0)
    return leaf, mb.Revolute("hinge", GROUND.point(0, 0), leaf.point(-0.4, 0))


@pytest.mark.parametrize(
    "make",
    [
        lambda leaf, hinge: mb.Stop("end", hinge, upper=1.5, restitution=0.3),
        lambda leaf, hinge: mb.SpringDamper("end", GROUND.point(1, 0), leaf.point(0, 0), 10.0),
        lambda leaf, hinge: mb.Torque("end", leaf, 1.0),
        lambda leaf, hinge: mb.Revolute("end", GROUND.point(0, 0), leaf.point(-0.4, 0)),
        lambda leaf, hinge: mb.Motion("end", hinge.angle, mb.t),
        lambda leaf, hinge: mb.Impact("end", 1.5 - leaf.theta, 0.3),
        lambda leaf, hinge: mb.Release(hinge, leaf.theta > 1.5),
    ],
)
def test_an_element_in_no_system_is_reported(make):
    leaf, hinge = gate()
    element = make(leaf, hinge)
    angle = element.angle if isinstance(element, mb.Revolute) else hinge.angle
    free = mb.Scene(mb.System(leaf, hinge), {"gate.omega": 2.0}, TIMES, {"angle": angle})
    (text,) = doubts(free)
    assert text.startswith(f"{element.title} is not part of the System and has no effect")
    assert text.endswith("Add it to System(...) if it belongs to the mechanism.")
    warned("is not part of the System", mb.linearize, mb.Scene(mb.System(leaf, hinge), times=TIMES))
    mb.System(leaf, hinge, element)
    assert doubts(mb.Scene(mb.System(leaf, hinge), {"gate.omega": 2.0}, TIMES)) == ()


def test_variants_and_elements_of_other_bodies_are_not_reported():
    leaf, hinge = gate()
    springs = [mb.TorsionSpring("spring", GROUND, leaf, stiffness) for stiffness in (1.0, 2.0)]
    other, post = mb.Body("other", 1.0, 0.1), mb.Body("post", 1.0, 0.1)
    kept = mb.Torque("push", other, 1.0), mb.TorsionSpring("link", post, leaf, 1.0), mb.Gravity(0, -1), mb.Input("u")
    mb.Stop("gone", hinge, upper=1.5, restitution=0.3)
    scene = mb.Scene(mb.System(leaf, hinge, springs[1]), {"gate.omega": 2.0}, TIMES)
    assert doubts(scene) == () and len(kept) == 4


def _housing(spin, inertia=1e-3, **start):
    """A free housing of 16 kg m^2 with a rotor."""
    box, rotor = mb.Body("box", 120.0, 16.0), mb.Body("rotor", 1.5, inertia)
    shaft = mb.Revolute("shaft", box.point(0, 0.1), rotor.point(-0.08, 0))
    motor = [mb.Motion("motor", rotor.theta, 94.25 * mb.t)] if spin == "motor" else []
    listed = {"rotor.omega": 94.25} if spin == "listed" else {}
    return mb.Scene(mb.System(box, rotor, shaft, *motor), listed | start, times=[0.0, 0.1])


@pytest.mark.parametrize("spin", ["motor", "listed"])
def test_a_heavy_body_that_starts_with_a_light_one_is_told(spin):
    sentence = "'box' moves with the lighter 'rotor' at the start .box.omega = 94.25.*List box.omega"
    run = warned(sentence, mb.simulate, _housing(spin))
    assert run["box.omega"][0] == pytest.approx(94.25)
    at_rest = mb.simulate(_housing(spin, **{"box.omega": 0.0}))  # warnings are errors
    assert at_rest["box.omega"][0] == 0 and at_rest["rotor.omega"][0] == pytest.approx(94.25)


def test_bodies_of_similar_size_start_together_without_a_word():
    run = mb.simulate(_housing("listed", inertia=4.0))  # as the panels of a satellite
    assert run["box.omega"][0] == pytest.approx(94.25)
