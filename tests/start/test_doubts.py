"""What is doubtful about a start is told in sentences."""

import numpy as np
import pytest
from faults import warned

import symmb as mb
from symmb.run.events import event_doubts

GROUND = mb.Ground()
TIMES = np.linspace(0.0, 2.0, 5)


def doubts(scene):
    return mb.DAESimulator(scene, mb.DormandPrince()).start.doubts


def pendulum(angle=None, gravity=-9.81, **more):
    rod = mb.Body("rod", 2.0, 0.1)
    system = mb.System(rod, mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, 0.5)), mb.Gravity(0, gravity))
    start = {} if angle is None else {"rod.theta": angle}
    return mb.Scene(system, start | more.pop("start", {}), TIMES, **more)


@pytest.mark.parametrize(("angle", "is_doubtful"), [(np.pi, True), (0.0, False), (3.0, False), (np.pi - 1e-3, False)])
def test_a_rod_upright_is_an_unstable_equilibrium(angle, is_doubtful):
    found = doubts(pendulum(angle))
    assert len(found) == is_doubtful and all("unstable equilibrium" in text for text in found)


def test_what_moves_or_has_no_weight_is_in_no_unstable_equilibrium():
    assert doubts(pendulum(np.pi, start={"rod.omega": 1e-3})) == ()
    assert doubts(pendulum(np.pi, gravity=0.0)) == ()


@pytest.mark.parametrize("guess", [np.pi, 2.5])
def test_an_equilibrium_that_is_solved_for_may_be_unstable(guess):
    """From upright nothing leads away; from elsewhere the rod settles hanging."""
    place = {"rod.theta": guess, "rod.x": 0.5 * np.sin(guess), "rod.y": -0.5 * np.cos(guess)}
    assert len(doubts(pendulum(guess=place, equilibrium=True))) == (guess == np.pi)


@pytest.mark.parametrize(("load", "is_doubtful"), [(0.9, False), (1.1, True)])
def test_a_column_buckles_above_its_critical_load(load, is_doubtful):
    """A rigid column of length l on a torsion spring c: the critical load is c / l."""
    column = mb.Body("column", 1.0, 0.1)
    system = mb.System(
        column,
        mb.Revolute("foot", GROUND.point(0, 0), column.point(0, -1)),
        mb.TorsionSpring("spring", GROUND, column, 30.0),
        mb.Force("load", column.point(0, 1), (0, -load * 30.0 / 2)),
    )
    assert len(doubts(mb.Scene(system, times=TIMES))) == is_doubtful


def test_locked_mechanisms_are_doubtful_and_driven_or_welded_ones_are_not():
    a, b = mb.Body("a", 1.0, 0.1), mb.Body("b", 1.0, 0.1)
    hinges = [
        mb.Revolute("A", GROUND.point(0, 0), a.point(-0.5, 0)),
        mb.Revolute("B", a.point(0.5, 0), b.point(-0.5, 0)),
        mb.Revolute("C", GROUND.point(1.2, 0.9), b.point(0.5, 0)),
    ]
    (told,) = doubts(mb.Scene(mb.System(a, b, *hinges, mb.Gravity(0, -1)), times=TIMES, guess={"b.theta": 1.0}))
    assert "locked: its constraints leave none of its 6 velocities" in told
    crank = mb.Revolute("A", GROUND.point(0, 0), a.point(-0.5, 0))
    assert doubts(mb.Scene(mb.System(a, crank, mb.Motion("drive", a.theta, mb.t)), times=TIMES)) == ()
    assert doubts(mb.Scene(mb.System(a, mb.Weld("A", GROUND.point(0, 0), a.point(0, 0))), times=TIMES)) == ()
    assert doubts(mb.Scene(mb.System(a, crank), {"a.theta": 0.1}, TIMES)) == ()


@pytest.mark.parametrize(("e", "masses", "is_doubtful"), [(0.5, 1.0, True), (1.0, 1.0, False), (1.0, 2.0, True)])
def test_impacts_of_one_instant_are_doubtful_if_their_order_matters(e, masses, is_doubtful):
    """Two balls hit a third one from both sides. Equal elastic balls exchange velocities, in whatever order."""
    balls = [mb.Body(name, m, pose=mb.Particle()) for name, m in zip("abc", (1.0, masses, 1.0), strict=True)]
    pairs = (("left", *balls[:2]), ("right", *balls[1:]))
    contacts = [mb.Impact(name, right.x - left.x - 1, e) for name, left, right in pairs]
    scene = mb.Scene(mb.System(*balls, *contacts), {"a.x": -2.0, "a.vx": 1.0, "c.x": 2.0, "c.vx": -1.0}, TIMES)
    if not is_doubtful:
        assert mb.simulate(scene).doubts == ()
        return
    with pytest.warns(mb.SymmbWarning, match="impacts of 'left', 'right' at t = 1 s are simultaneous"):
        run = mb.simulate(scene)
    assert event_doubts(run.events) == run.doubts


def test_impacts_of_one_instant_that_have_nothing_to_do_with_each_other_are_not_doubtful():
    balls = [mb.Body(name, 1.0, pose=mb.Particle()) for name in "ab"]
    floors = [mb.Impact(f"floor_{ball.name}", ball.y, 0.5) for ball in balls]
    system = mb.System(*balls, *floors, mb.Gravity(0, -9.81))
    run = mb.simulate(mb.Scene(system, {"a.y": 1.0, "b.y": 1.0}, TIMES[:3]))
    assert len(run.events) >= 2 and event_doubts(run.events) == ()


@pytest.mark.parametrize("axis", [(1, 0, 0), (1, 2, 0), (0.3, -1, 2)])
def test_a_particle_on_a_rail_is_not_locked(axis):
    """Along x nothing acts on it: the coordinate leaves the state, but it is free."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    rail = mb.PointOnLine("rail", GROUND.point(0, 0), ball.point(0, 0), axis=axis)
    assert doubts(mb.Scene(mb.System(ball, rail, mb.Gravity(0, -9.81)), times=TIMES)) == ()
    pin = mb.Spherical("pin", GROUND.point(0, 0), ball.point(0, 0))
    (text,) = doubts(mb.Scene(mb.System(ball, pin, mb.Gravity(0, -9.81)), times=TIMES))
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
    with pytest.warns(mb.SymmbWarning, match="is not part of the System"):
        mb.linearize(mb.Scene(mb.System(leaf, hinge), times=TIMES))
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
