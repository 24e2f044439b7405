"""Redundant rows: those that stay independent are kept, else all are solved at their rank; Bricard's mechanism."""

from functools import cache

import bricard
import numpy as np
import pytest
from driven_loops import driven_loop
from mechanisms import swing
from numpy.testing import assert_allclose
from problems import windows_in_space
from scipy.spatial.transform import Rotation

import symmb as mb

TIMES = np.linspace(0, 10, 51)


@pytest.fixture(scope="module")
def reference() -> np.ndarray:
    return bricard.reference(TIMES)


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
    run = mb.simulate(bricard.scene(TIMES), solver)
    assert_allclose(run.values, reference, rtol=0, atol=error)
    assert run.energy_drift < drift
    assert "warning" not in str(run)


@pytest.mark.parametrize(
    "solver", [mb.IDAS(rtol=1e-8), pytest.param(mb.StabilizedIndex2(), marks=pytest.mark.long)], ids=repr
)
def test_solvers_with_multipliers_pass_where_single_rows_are_dependent(solver, reference):
    """Without the first hinge's rows, which a choice at the start leaves out, no motion goes on at 1.25 s."""
    assert_allclose(mb.simulate(bricard.scene(TIMES[:8]), solver).values, reference[:8], rtol=0, atol=1e-5)


@pytest.mark.long
def test_bricard_with_uncertain_masses_in_lanes():
    scene = bricard.scene(TIMES)
    P = np.random.default_rng(1).uniform(0.99, 1.01, (100, 5))
    ensemble = mb.DAESimulator(scene, mb.DormandPrince()).run(P)
    assert ensemble.ok.all()
    for k in (0, 57, 99):
        assert_allclose(ensemble.Y[k], bricard.reference(TIMES, P[k]), rtol=0, atol=1e-6)


def test_all_rows_are_kept_where_no_choice_of_rows_lasts():
    simulator = mb.DAESimulator(bricard.scene(), mb.DormandPrince())
    assert (simulator.dae.n_r, simulator.dae.rank) == (30, 29)
    assert mb.DAESimulator(windows_in_space(), mb.DormandPrince()).dae.vanishing is None


def four_bar(R: Rotation) -> mb.Trajectory:
    """A four-bar of spatial bodies whose rows turn with the bodies: hinges are declared from bar to bar."""
    ground, z = mb.Ground(), tuple(R.apply((0, 0, 1)))
    feet = {"left": (0.0, 0.0, 0.0), "right": (2.0, -0.5, 0.0)}
    bars = {
        name: mb.Body(name, 1.0, R.as_matrix() @ np.diag(J) @ R.as_matrix().T, mb.Spatial())
        for name, J in (("left", (0.1, 1e-3, 0.1)), ("coupler", (1e-3, 0.4, 0.4)), ("right", (0.1, 1e-3, 0.1)))
    }

    def point(bar: str, *at: float):
        return bars[bar].point(*R.apply(at)) if bar in bars else ground.point(*R.apply(at))

    hinges = [
        mb.Revolute("A", point("left", 0, -0.5, 0), point("", *feet["left"]), axis=z),
        mb.Revolute("B", point("coupler", -1, 0, 0), point("left", 0, 0.5, 0), axis=z),
        mb.Revolute("C", point("right", 0, 0.75, 0), point("coupler", 1, 0, 0), axis=z),
        mb.Revolute("D", point("", *feet["right"]), point("right", 0, -0.75, 0), axis=z),
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
    ground = mb.Ground()
    rod = mb.Body("rod", 1.0, half**2 / 3, pose=mb.Planar())
    left, right, centre, origin = rod.point(-half, 0), rod.point(half, 0), rod.point(0, 0), ground.point(0, 0)
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
    g, turned, ground, n = 1.0, -0.4, mb.Ground(), 4
    plate, elements = mb.Body("plate", 1.0, (0.1, 0.1, 0.1), mb.Spatial()), []
    along = np.array([np.cos(turned), np.sin(turned), 0.0])
    guess = dict(zip(("plate.x", "plate.y"), along, strict=False))
    for i, pin in enumerate([(0, 0, 0), (1, 0.2, 0), (0.4, 0.9, 0), (0.3, -0.9, 0)]):
        crank = mb.Body(f"c{i}", 1.0, (0.01, 1 / 12, 1 / 12), mb.Spatial())
        foot = mb.Revolute(f"A{i}", ground.point(*pin), crank.point(-0.5, 0, 0))
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
