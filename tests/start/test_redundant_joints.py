"""Joints that repeat what others do, about any axis: the motion is that without them, in every coordinates."""

import numpy as np
import pytest
from mechanisms import exact, swing
from numpy.testing import assert_allclose
from redundant_scenes import mechanism
from scipy.spatial.transform import Rotation

import symmb as mb

GROUND = mb.Ground()
TIMES = np.linspace(0, 1, 5)
MASS, INERTIA, PIN, GRAVITY = 20.0, (4.0, 1.0, 3.0), np.array([0.11, 0.23, 0.37]), np.array([0, 0, -9.81])
SECOND = ("Revolute", "Spherical", "Cylindrical", "PointOnLine", "Distance")
AXES = [(0.1, 0.07, 1.0), (1.0, 2.0, 3.0), (-0.3, 0.9, 0.2)]


def door(direction, second, centre=(0.4, 0.1, 0.9), **more):
    """A door on a hinge that leans, and on a second joint that the hinge makes redundant; p = (m,)."""
    p = mb.Parameters(m=MASS)
    axis = np.array(direction) / np.linalg.norm(direction)
    leaf = mb.Body("leaf", p.m, INERTIA, mb.Spatial(), com=tuple(centre))
    hinge = mb.Revolute("lower", GROUND.point(*PIN), leaf.point(0, 0, 0), axis=tuple(axis))
    above, aside = PIN + 1.7 * axis, leaf.point(*(1.7 * axis))
    foot = {"PointOnLine": PIN, "Distance": np.zeros(3)}.get(second, above)
    own = {"Spherical": {}, "Distance": {"length": float(np.linalg.norm(above))}}.get(second, {"axis": tuple(axis)})
    upper = getattr(mb, second)("upper", GROUND.point(*foot), aside, **own)
    system = mb.System(leaf, hinge, upper, mb.Gravity(*GRAVITY), parameters=p)
    return mb.Scene(system, times=TIMES, outputs={"angle": hinge.angle}, box=mb.Box.around(p, 0.1), **more)


def door_by_hand(direction, m=MASS, centre=(0.4, 0.1, 0.9)):
    """Angles (n_t,) of a pendulum about the hinge."""
    axis, c = np.array(direction) / np.linalg.norm(direction), np.array(centre)
    inertia = axis @ (INERTIA * axis) + m * np.sum(np.cross(axis, c) ** 2)

    def rate(_, z):
        return [z[1], axis @ np.cross(Rotation.from_rotvec(z[0] * axis).apply(c), m * GRAVITY) / inertia]

    return exact(rate, (0, 0), TIMES)[:, 0]


@pytest.mark.parametrize("coordinates", ["body", "joint"])
@pytest.mark.parametrize(("direction", "second"), list(zip([*AXES, *AXES[:2]], SECOND, strict=True)))
def test_a_door_on_two_hinges_swings_as_on_one(direction, second, coordinates):
    run = mb.simulate(door(direction, second, coordinates=coordinates), mb.DormandPrince(rtol=1e-9))
    assert_allclose(run["angle"], door_by_hand(direction), rtol=0, atol=1e-7)
    assert not run.doubts


@pytest.mark.parametrize(("direction", "second"), list(zip(AXES, ("Revolute", "Spherical", "Distance"), strict=True)))
def test_a_study_of_a_door_on_two_hinges_has_its_corners(direction, second):
    bounds = mb.propagate(door(direction, second), mb.Vertex())
    corners = [door_by_hand(direction, m) for m in (0.9 * MASS, 1.1 * MASS)]
    assert_allclose(bounds["angle"][0], np.min(corners, axis=0), rtol=0, atol=1e-6)
    assert_allclose(bounds["angle"][1], np.max(corners, axis=0), rtol=0, atol=1e-6)
    assert not bounds.doubts


@pytest.mark.parametrize("second", SECOND)
@pytest.mark.parametrize("coordinates", ["body", "joint"])
def test_a_hanging_door_on_two_hinges_has_one_frequency(second, coordinates):
    direction = AXES[2]
    axis, down = np.array(direction) / np.linalg.norm(direction), np.array([0, 0, -1.0])
    lowest = down - (down @ axis) * axis
    centre = 0.4 * lowest / np.linalg.norm(lowest) + 0.9 * axis
    linear = mb.linearize(door(direction, second, centre, coordinates=coordinates))
    inertia = axis @ (INERTIA * axis) + MASS * 0.4**2
    square = MASS * 9.81 * 0.4 * np.linalg.norm(lowest) / inertia
    assert_allclose(linear.frequencies, [np.sqrt(square) / (2 * np.pi)], rtol=1e-9)


def test_two_arms_of_which_one_has_two_hinges_have_two_frequencies():
    axis = np.array([0.3, -0.2, 0.5]) / np.linalg.norm([0.3, -0.2, 0.5])
    found = []
    for count in (1, 2):
        a = mb.Body("a", 2.0, (0.1, 0.2, 0.15), mb.Spatial(), com=(0.3, 0.1, 0))
        b = mb.Body("b", 1.0, (0.03, 0.02, 0.04), mb.Spatial(), com=(0.2, 0, -0.1))
        at = [s * axis for s in (0.0, 0.5)[:count]]
        hinges = [mb.Revolute(f"h{k}", GROUND.point(*r), a.point(*r), axis=tuple(axis)) for k, r in enumerate(at)]
        elbow = mb.Revolute("elbow", a.point(0.6, 0.1, 0.05), b.point(0, 0, 0), axis=(1, 0.4, -0.2))
        system = mb.System(a, b, *hinges, elbow, mb.Gravity(0, 0, -9.81))
        found.append(mb.linearize(mb.Scene(system, times=[0, 1.0], equilibrium=True)).frequencies)
    assert_allclose(found[1], found[0], rtol=1e-8)
    assert len(found[1]) == 2


PLANAR = {
    "fork": lambda a: [mb.Revolute("second", GROUND.point(0.1, 0.2), a.point(-0.5, 0))],
    "line": lambda a: [mb.PointOnLine("second", GROUND.point(0.1, 0.2), a.point(-0.5, 0), axis=(1, 0.3, 0))],
    "strut": lambda a: [mb.Distance("second", GROUND.point(0.4, 0.6), a.point(-0.5, 0), 0.5)],
}


@pytest.mark.parametrize("coordinates", ["body", "joint", None])
@pytest.mark.parametrize("kind", PLANAR)
def test_a_planar_rod_with_a_redundant_row_is_a_pendulum(kind, coordinates):
    a = mb.Body("a", 1.0, 0.1)
    hinge = mb.Revolute("hinge", GROUND.point(0.1, 0.2), a.point(-0.5, 0))
    system = mb.System(a, hinge, *PLANAR[kind](a), mb.Gravity(0, -9.81))
    scene = mb.Scene(system, times=TIMES, outputs={"angle": a.theta}, coordinates=coordinates)
    known = swing(9.81 * 0.5 / (0.1 + 0.25), TIMES)
    assert_allclose(mb.simulate(scene)["angle"], known[:, 0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("coordinates", ["body", "joint"])
@pytest.mark.parametrize("pose", [mb.Planar, mb.Spatial])
def test_a_strut_between_welded_bodies_changes_nothing(pose, coordinates):
    """Both bodies are one, of mass 2, whose inertia is that of the parts about the hinge."""
    inertia = 0.1 if pose is mb.Planar else (0.1, 0.1, 0.1)
    a, b = mb.Body("a", 1.0, inertia, pose()), mb.Body("b", 1.0, inertia, pose())
    system = mb.System(
        a,
        b,
        mb.Revolute("hinge", GROUND.point(0, 0), a.point(-0.5, 0)),
        mb.Weld("weld", a.point(0.5, 0), b.point(-0.2, 0)),
        mb.Distance("strut", a.point(0.2, 0.1), b.point(0.1, 0.3), float(np.hypot(0.6, 0.2))),
        mb.Gravity(0, -9.81),
    )
    run = mb.simulate(mb.Scene(system, times=TIMES, outputs={"y": a.y}, coordinates=coordinates))
    inertia = 2 * 0.1 + 0.5**2 + 1.2**2
    known = swing(9.81 * (0.5 + 1.2) / inertia, TIMES)
    assert_allclose(run["y"], 0.5 * np.sin(known[:, 0]), rtol=0, atol=1e-6)
    assert not run.doubts


@pytest.mark.parametrize("seed", [1, 3, 4, 5, 11, 72090])
def test_random_mechanisms_move_as_without_their_redundant_joints(seed):
    """A small draw of tests/benchmarks/redundant_mechanisms.py, in coordinates of joints against those of bodies."""
    m = mechanism(seed)
    known = mb.simulate(m.plain(), mb.CVODES(rtol=1e-9))
    run = mb.simulate(m.redundant("joint"), mb.DormandPrince(rtol=1e-9))
    size = np.abs(known.values).max(axis=0)
    assert_allclose(run.values / size, known.values / size, rtol=0, atol=1e-6)
    assert not run.doubts


@pytest.mark.parametrize("coordinates", ["body", "joint"])
def test_hinges_that_fit_at_the_nominal_parameters_only_are_told(coordinates):
    """The upper hinge moves aside: nothing starts. Or a strut's end leaves the axis: nothing moves."""
    p, axis = mb.Parameters(e=0.0), np.array(AXES[1]) / np.linalg.norm(AXES[1])
    up, leaf = 1.7 * axis, mb.Body("leaf", MASS, INERTIA, mb.Spatial(), com=(0.4, 0.1, 0.9))
    hinge = mb.Revolute("lower", GROUND.point(0, 0, 0), leaf.point(0, 0, 0), axis=tuple(axis))
    above = GROUND.point(up[0] + p.e, up[1], up[2])
    aside = leaf.point(up[0], up[1] + p.e, up[2])
    length = ((up[0] - 1) ** 2 + (up[1] + p.e) ** 2 + up[2] ** 2) ** 0.5
    apart = mb.Revolute("upper", above, leaf.point(*up), axis=tuple(axis)), "contradict each other"
    locked = mb.Distance("upper", GROUND.point(1, 0, 0), aside, length), "leave fewer degrees of freedom"
    for second, told in (apart, locked):
        system = mb.System(leaf, hinge, second, mb.Gravity(*GRAVITY), parameters=p)
        scene = mb.Scene(system, times=TIMES, coordinates=coordinates, box=mb.Box(e=(-0.01, 0.01)))
        simulator = mb.DAESimulator(scene, mb.DormandPrince())
        (doubt,) = simulator.start.doubts
        assert "'lower', 'upper' are redundant at the nominal parameters, but not at e = 0.0" in doubt and told in doubt
        _, reasons = simulator.start.states(np.array([[0.0], [0.01]]))
        assert reasons[0] == "" and (reasons[1] != "") == ("contradict" in told)
