"""Redundant rows and joints: rows that stay independent are kept, and the motion is that without the others."""

from dataclasses import replace
from functools import cache

import bricard
import numpy as np
import pytest
from driven_loops import driven_loop
from machines import GROUND, pendulum
from mechanisms import exact, swing
from numpy.testing import assert_allclose
from overconstrained import LINKAGES, bennett
from problems import windows_in_space
from redundant_scenes import mechanism
from scipy.spatial.transform import Rotation

import symmb as mb

SPAN = np.linspace(0, 10, 51)


@pytest.fixture(scope="module")
def reference() -> np.ndarray:
    return bricard.reference(SPAN)


@pytest.mark.parametrize(
    ("solver", "error", "drift"),
    [
        (None, 1e-6, 1e-7),
        pytest.param(mb.DormandPrince(), 1e-6, 1e-7, marks=pytest.mark.long),
        (mb.DormandPrince(rtol=1e-11), 1e-9, 1e-10),
        pytest.param(mb.DormandPrince(rtol=1e-10, stabilization=None), 1e-7, 1e-8, marks=pytest.mark.long),
        (mb.DormandPrince(stabilization=mb.AugmentedLagrangian()), 1e-6, 1e-7),
        pytest.param(mb.StateSpace(), 1e-6, 1e-7, marks=pytest.mark.long),
    ],
    ids=repr,
)
def test_bricard_moves_as_in_relative_coordinates(solver, error, drift, reference):
    run = mb.simulate(bricard.scene(SPAN), solver)
    assert_allclose(run.values, reference, rtol=0, atol=error)
    assert run.energy_drift < drift
    assert "warning" not in str(run)


@pytest.mark.parametrize(
    "solver", [mb.IDAS(rtol=1e-8), pytest.param(mb.StabilizedIndex2(), marks=pytest.mark.long)], ids=repr
)
def test_solvers_with_multipliers_pass_where_single_rows_are_dependent(solver, reference):
    """Without the first hinge's rows, which a choice at the start leaves out, no motion goes on at 1.25 s."""
    assert_allclose(mb.simulate(bricard.scene(SPAN[:8]), solver).values, reference[:8], rtol=0, atol=1e-5)


@pytest.mark.long
def test_bricard_with_uncertain_masses_in_lanes():
    scene = bricard.scene(SPAN)
    P = np.random.default_rng(1).uniform(0.99, 1.01, (100, 5))
    ensemble = mb.DAESimulator(scene, mb.DormandPrince()).run(P)
    assert ensemble.ok.all()
    for k in (0, 57, 99):
        assert_allclose(ensemble.Y[k], bricard.reference(SPAN, P[k]), rtol=0, atol=1e-6)


def test_all_rows_are_kept_where_no_choice_of_rows_lasts():
    simulator = mb.DAESimulator(bricard.scene(), mb.DormandPrince())
    assert (simulator.dae.n_r, simulator.dae.rank) == (30, 29)
    assert mb.DAESimulator(windows_in_space(), mb.DormandPrince()).dae.vanishing is None


def test_a_rank_is_told_without_solving_for_accelerations(monkeypatch):
    """With many redundant loops, these Functions take minutes."""
    system, rows, nullities = bricard.scene().system, range(30), (1, 1)
    monkeypatch.setattr(type(system), "solve", lambda *_: pytest.fail("accelerations are derived"))
    monkeypatch.setattr(
        "symmb.equations.model.compilation.vanishing_rows", lambda *_: pytest.fail("a Function is derived")
    )
    dae = mb.compile_dae(system, rows, nullities)
    assert (dae.rank, dae.position_rank) == (29, 29)


def four_bar(R: Rotation) -> mb.Trajectory:
    """A four-bar of spatial bodies whose rows turn with the bodies: hinges are declared from bar to bar."""
    z = tuple(R.apply((0, 0, 1)))
    bars = {
        name: mb.Body(name, 1.0, R.as_matrix() @ np.diag(J) @ R.as_matrix().T, mb.Spatial())
        for name, J in (("left", (0.1, 1e-3, 0.1)), ("coupler", (1e-3, 0.4, 0.4)), ("right", (0.1, 1e-3, 0.1)))
    }

    def point(bar: str, *at: float):
        return bars[bar].point(*R.apply(at)) if bar in bars else GROUND.point(*R.apply(at))

    hinges = [
        mb.Revolute("A", point("left", 0, -0.5, 0), point("", 0, 0, 0), axis=z),
        mb.Revolute("B", point("coupler", -1, 0, 0), point("left", 0, 0.5, 0), axis=z),
        mb.Revolute("C", point("right", 0, 0.75, 0), point("coupler", 1, 0, 0), axis=z),
        mb.Revolute("D", point("", 2, -0.5, 0), point("right", 0, -0.75, 0), axis=z),
    ]
    at = {"left": (0, 0.5, 0), "coupler": (1, 1, 0), "right": (2, 0.25, 0)}
    guess = {f"{bar}.{n}": float(x) for bar, r in at.items() for n, x in zip("xyz", R.apply(r), strict=True)}
    lean = mb.rotation(axis=z, angle=-0.3)
    push = mb.Force("push", bars["coupler"].point(0, 0, 0), tuple(R.apply((0, -9.81, 0))))
    system = mb.System(*bars.values(), *hinges, push)
    return mb.simulate(mb.Scene(system, {"left.rotation": lean}, np.linspace(0, 3, 16), guess=guess))


@cache
def flat_four_bar() -> mb.Trajectory:
    return four_bar(Rotation.identity())


@pytest.mark.parametrize("seed", range(3))
def test_a_planar_loop_in_any_plane_moves_as_it_does_in_its_own(seed):
    turned = Rotation.random(random_state=seed)
    flat, run = flat_four_bar(), four_bar(turned)
    for bar in ("left", "coupler", "right"):
        r = np.column_stack([run[f"{bar}.{n}"] for n in "xyz"])
        assert_allclose(turned.inv().apply(r), np.column_stack([flat[f"{bar}.{n}"] for n in "xyz"]), atol=1e-6)
    assert run.energy_drift < 1e-6


@pytest.mark.parametrize("half", [1e-6, 0.03, 0.5, 30.0])
def test_a_trammel_of_any_size_turns_as_a_pendulum(half):
    """Each two of its three rows depend on each other somewhere. Its angle starts at more than its size."""
    angle, rate, k = -2.5, 5.0, 3 / 4  # the rod turns about the centre of its ends' circle, inertia 4/3 m half^2
    rod = mb.Body("rod", 1.0, half**2 / 3, pose=mb.Planar())
    left, right, centre, origin = rod.point(-half, 0), rod.point(half, 0), rod.point(0, 0), GROUND.point(0, 0)
    system = mb.System(
        rod,
        mb.Distance("bar", origin, centre, half),
        mb.PointOnLine("upright", origin, left, axis=(0, 1, 0)),
        mb.PointOnLine("level", origin, right, axis=(1, 0, 0)),
        mb.Gravity(0, -half),
    )
    times = np.linspace(0, 5, 21)
    place = {"rod.x": half * np.cos(angle), "rod.y": half * np.sin(angle)}
    run = mb.simulate(mb.Scene(system, {"rod.theta": -angle, "rod.omega": -rate}, times, guess=place))
    known = swing(k, times, angle, rate).T
    assert_allclose(-run["rod.theta"], known[0], rtol=0, atol=1e-6)
    assert_allclose(run["rod.vx"] / half, -known[1] * np.sin(known[0]), rtol=0, atol=1e-6)
    assert not run.doubts


def test_rows_that_are_redundant_everywhere_are_left_out_where_others_are_not():
    """A plate on four cranks in space. 11 rows too many, those across the plane everywhere, others by turns."""
    g, turned, n = 1.0, -0.4, 4
    plate, elements = mb.Body("plate", 1.0, (0.1, 0.1, 0.1), mb.Spatial()), []
    along = np.array([np.cos(turned), np.sin(turned), 0.0])
    guess = dict(zip(("plate.x", "plate.y"), along, strict=False))
    for i, pin in enumerate([(0, 0, 0), (1, 0.2, 0), (0.4, 0.9, 0), (0.3, -0.9, 0)]):
        crank = mb.Body(f"c{i}", 1.0, (0.01, 1 / 12, 1 / 12), mb.Spatial())
        foot = mb.Revolute(f"A{i}", GROUND.point(*pin), crank.point(-0.5, 0, 0))
        elements += [crank, foot, mb.Revolute(f"B{i}", crank.point(0.5, 0, 0), plate.point(*pin))]
        guess |= dict(zip((f"c{i}.x", f"c{i}.y"), pin + along / 2, strict=False))
        guess[f"c{i}.rotation"] = mb.rotation((0, 0, 1), turned)
    start = {"c0.rotation": guess.pop("c0.rotation"), "c0.omega": (0, 0, -2.0)}
    times = np.linspace(0, 4, 21)
    scene = mb.Scene(mb.System(plate, *elements, mb.Gravity(0, -g)), start, times, guess=guess)
    simulator = mb.DAESimulator(scene, mb.DormandPrince())
    assert simulator.dae.rank == 29
    assert simulator.dae.n_r < 34
    k = g * (1 + n / 2) / (1 + n / 3)  # the plate does not turn
    known = swing(k, times, turned, -2.0).T
    run = mb.simulate(scene, mb.DormandPrince())
    assert_allclose(run["plate.x"], np.cos(known[0]), rtol=0, atol=1e-6)
    assert_allclose(run["c3.omega_z"], known[1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("coordinates", ["body", "joint"])
@pytest.mark.parametrize("seed", [0, 1, 3, 4])
def test_driven_loops_go_on_where_rows_of_the_start_depend_on_each_other(seed, coordinates):
    """A four-bar, a cardan shaft, and jacks: rows of a nut on a trunnion shrink as the screw makes a quarter turn.

    A larger draw: tests/benchmarks/driven_mechanisms.py.
    """
    loop = driven_loop(seed)
    run = mb.simulate(loop.scene(coordinates))
    assert_allclose(run.values, loop.known, rtol=0, atol=1e-8)
    assert not run.doubts


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
    "fork": lambda m: mb.Revolute("second", GROUND.point(0, 0), m.rod.point(-0.5, 0)),
    "line": lambda m: mb.PointOnLine("second", GROUND.point(0, 0), m.rod.point(-0.5, 0), axis=(1, 0.3, 0)),
    "strut": lambda m: mb.Distance("second", GROUND.point(0.3, 0.4), m.rod.point(-0.5, 0), 0.5),
}


@pytest.mark.parametrize("coordinates", ["body", "joint", None])
@pytest.mark.parametrize("kind", PLANAR)
def test_a_planar_rod_with_a_redundant_row_is_a_pendulum(kind, coordinates):
    run = pendulum(PLANAR[kind], length=0.5).run("theta", TIMES, coordinates=coordinates)
    known = swing(9.81 * 0.5 / (0.1 + 0.25), TIMES)
    assert_allclose(run["theta"], known[:, 0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("coordinates", ["body", "joint"])
@pytest.mark.parametrize("pose", [mb.Planar, mb.Spatial])
def test_a_strut_between_welded_bodies_changes_nothing(pose, coordinates):
    """Both bodies are one, of mass 2, whose inertia is that of the parts about the hinge."""
    inertia = 0.1 if pose is mb.Planar else (0.1, 0.1, 0.1)
    b, length = mb.Body("b", 1.0, inertia, pose()), float(np.hypot(0.6, 0.2))
    weld = lambda m: mb.Weld("weld", m.rod.point(0.5, 0), b.point(-0.2, 0))  # noqa: E731
    strut = lambda m: mb.Distance("strut", m.rod.point(0.2, 0.1), b.point(0.1, 0.3), length)  # noqa: E731
    welded = pendulum(b, weld, strut, length=0.5, pose=pose())
    run = welded.run("y", TIMES, coordinates=coordinates)
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


# Linkages that move though their joints have too many rows: runs and checks against Lagrange's equation.


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda linkage: linkage.__name__)
def test_overconstrained_linkages_move_and_are_checked(linkage, seed):
    ring, rate = linkage(seed), float(np.random.default_rng(seed).uniform(2, 5))
    times, known = ring.motion(3.0, rate)
    run = mb.simulate(ring.scene(times, rate), check=True)
    assert_allclose(run.values, known, rtol=0, atol=1e-6 * np.abs(known).max())
    assert run.error is not None and run.error.max() < 1e-6 * np.abs(known).max()
    assert not run.doubts


@pytest.mark.parametrize("solver", [mb.DormandPrince(rtol=1e-12, stabilization=None), mb.DormandPrince()], ids=repr)
@pytest.mark.parametrize("seed", [4])
def test_rows_that_vanish_in_passing_do_not_magnify_the_drift(seed, solver):
    """In coordinates of joints a row of the last hinge of Bennett's linkage passes 0."""
    ring, rate = bennett(seed), float(np.random.default_rng(seed).uniform(2, 5))
    times, known = ring.motion(3.0, rate)
    run = mb.simulate(replace(ring.scene(times, rate), coordinates="joint"), solver)
    assert_allclose(run.values, known, rtol=0, atol=1e-6 * np.abs(known).max())
