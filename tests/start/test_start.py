"""Starting: what is listed holds exactly, the rest follows from the constraints on one assembly branch."""

import casadi as ca
import numpy as np
import pytest
from faults import refused
from joints import numbers
from mechanisms import four_bar
from numpy.testing import assert_allclose, assert_array_equal
from test_start_velocities import cart

import symmb as mb

GROUND = mb.Ground()


def started(scene, P=None):
    """Start of a scene, with coordinates and velocities by name for every sample."""
    simulator = mb.DAESimulator(scene, mb.DormandPrince())  # without pilot runs, which would be compiled
    P = simulator.start.dae.p_nominal[None] if P is None else np.asarray(P, dtype=float)
    x, reasons = simulator.start.states(P)
    assert not any(reasons), reasons
    dae = simulator.dae
    residuals = [numbers(dae.Phi, *dae.arguments(row, p, simulator.times[0])) for row, p in zip(x, P, strict=True)]
    assert_allclose(residuals, 0, atol=1e-13)
    rates = [numbers(dae.Phi_dot, *dae.arguments(row, p, simulator.times[0])) for row, p in zip(x, P, strict=True)]
    assert_allclose(rates, 0, atol=1e-12)
    return simulator.start, dict(zip((*dae.q_names, *dae.v_names, *dae.s_names), x.T, strict=True))


def pendulum():
    """A rod of length l on a hinge at the origin, hanging along -y at theta = 0."""
    p = mb.Parameters(l=1.2, tilt=0.3)
    rod = mb.Body("rod", p.l, p.l**3 / 12, mb.Planar())
    return mb.System(rod, mb.Revolute("hinge", GROUND.point(0, 0), rod.point(0, p.l / 2)), parameters=p), p


P = [[1.2, 0.3], [0.7, -1.0], [1.0, 2.0]]


def test_listed_values_hold_exactly_and_the_others_follow():
    system, p = pendulum()
    start, x = started(mb.Scene(system, {"rod.theta": p.tilt, "rod.omega": 2 * p.l}), P)
    lengths, tilts = np.array(P).T
    assert_array_equal(x["rod.theta"], tilts)
    assert_array_equal(x["rod.omega"], 2 * lengths)
    assert_allclose(x["rod.x"], lengths / 2 * np.sin(tilts), atol=1e-14)
    assert_allclose(x["rod.vx"], lengths**2 * np.cos(tilts), atol=1e-14)
    assert (start.listed, start.solved, start.free) == (("rod.theta", "rod.omega"), ("rod.x", "rod.y"), ())


@pytest.mark.parametrize(("guess", "sign"), [(0.4, 1), (-0.4, -1), (np.pi - 0.4, 1), (0.0, None)])
def test_the_guess_picks_the_branch(guess, sign):
    """With y listed, the rod may lean left or right; straight down the slope vanishes and nothing is found."""
    system, p = pendulum()
    y = -p.l / 2 * ca.cos(0.3)
    scene = mb.Scene(system, {"rod.y": y}, guess={"rod.theta": guess})
    if sign is None:
        refused(r"'hinge'.* better guess", mb.DAESimulator, scene, error=mb.AssemblyError)
        return
    _, x = started(scene, P)
    assert_allclose(np.sin(x["rod.theta"]), sign * np.sin(0.3), atol=1e-12)
    assert_array_equal(x["rod.y"], [-row[0] / 2 * np.cos(0.3) for row in P])


def test_what_the_constraints_leave_open_stays_at_its_guess():
    """A ball on a rod: the least move from the guess is along the line to the anchor."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Distance("rope", GROUND.point(0, 0), ball.point(0, 0), 2.0), mb.Gravity(0, 0, -1))
    start, x = started(mb.Scene(system, guess={"ball.x": 3.0, "ball.y": 4.0}))
    assert_allclose([x["ball.x"][0], x["ball.y"][0], x["ball.z"][0]], [1.2, 1.6, 0], atol=1e-12)
    assert len(start.solved) == 1 and len(start.free) == 2 and start.listed == ()


def test_defaults_are_zero_and_the_identity_rotation():
    top = mb.Body("top", 1.0, (1, 1, 1), mb.Spatial())
    scene = mb.Scene(mb.System(top, mb.Gravity(0, 0, -1)))
    simulator = mb.DAESimulator(scene)
    assert_array_equal(simulator.start.states(np.zeros((1, 0)))[0], [[0, 0, 0, 1, *[0] * 9]])
    names = ("top.x = 0", "top.y = 0", "top.z = 0", "top.rotation_x", "top.rotation_y", "top.rotation_z")
    assert simulator.start.free == names
    assert "left free top.x = 0, top.y = 0" in str(mb.simulate(scene))


@pytest.mark.parametrize("axis_b", [(0, 0, 1), (0, -1, 0), (1, -1, 0), (0, 1, 0.5)])
def test_axes_far_apart_at_the_guess_are_aligned(axis_b):
    body = mb.Body("body", 1.0, (0.1, 0.1, 0.2), mb.Spatial())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), body.point(0, 0), axis=(0, 1, 0), axis_b=axis_b)
    run = mb.simulate(mb.Scene(mb.System(body, hinge)))
    axis = run(body.rotation @ ca.DM(axis_b))[0] / np.linalg.norm(axis_b)
    assert_allclose(axis, [0, 1, 0], atol=1e-12)


def test_what_is_left_free_is_told_where_assembly_put_it():
    rod = mb.Body("rod", 1.0, 0.1)
    system = mb.System(rod, mb.Revolute("hinge", GROUND.point(0, 0), rod.point(-0.5, 0)))
    run = mb.simulate(mb.Scene(system, guess={"rod.theta": 1.0, "rod.x": 0.5}))
    assert f"left free rod.theta = {run['rod.theta'][0]:.6g}" in str(run)
    assert "held" not in str(run)  # nothing is listed


def test_velocities_are_told_as_positions_are():
    """A rod on a cart: nothing determines its rate, and the rail and the pin determine all others."""
    run = mb.simulate(mb.Scene(cart(), {"cart.x": 0.0, "cart.vx": 1.0, "rod.theta": 0.3}))
    line = next(line for line in str(run).split("\n") if line.startswith("  start"))
    assert "held cart.x, cart.vx, rod.theta; solved for" in line
    assert line.endswith("rod.y, cart.vy, cart.omega, rod.vx, rod.vy; left free rod.omega = 0")


def test_masses_and_lengths_must_be_positive_for_every_sample():
    p = mb.Parameters(m=2.0, L=1.0)
    ball = mb.Body("ball", p.m, pose=mb.Particle())
    rope = mb.Distance("rope", GROUND.point(0, 0), ball.point(0, 0), p.L)
    system = mb.System(ball, rope, mb.Gravity(0, -9.81), parameters=p)
    scene = mb.Scene(system, guess={"ball.y": -1.0}, times=[0.0, 0.5])
    with pytest.raises(mb.SimulationError, match=r"Body 'ball': mass is -2, not positive"):
        mb.simulate(scene, parameters={"m": -2.0})
    ensemble = mb.DAESimulator(scene).run(np.array([[2.0, 1.0], [2.0, -1.0], [-1.0, 1.0]]))
    assert_array_equal(ensemble.ok, [True, False, False])
    assert "Distance 'rope': length is -1, not positive" in ensemble.messages[0]
    refused(r"box: Body 'ball': mass is -1, not positive, at m = -1", scene.with_box, mb.Box(m=(-1, 3)))


def test_numbers_of_elements_and_laws_must_be_positive_for_every_sample():
    p = mb.Parameters(k=(1e5, "N/m"), c=1.0)
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    floor = mb.Contact("floor", ball.point(0, 0), GROUND.point(0, 0), (0, 1, 0), mb.KelvinVoigt(p.k, p.c), radius=0.1)
    scene = mb.Scene(mb.System(ball, floor, parameters=p), {"ball.y": 0.2}, [0.0, 0.1])
    refused(r"box: Contact 'floor': stiffness is -1, not positive, at k = -1 N/m", scene.with_box, mb.Box(k=(-1, 2)))
    refused(r"box: Contact 'floor': damping is -2, not positive, at c = -2", scene.with_box, mb.Box(c=(-2, 2)))
    ensemble = mb.DAESimulator(scene).run(np.array([[1e5, 0.0], [0.0, 1.0], [1e5, -1.0]]))
    assert_array_equal(ensemble.ok, [True, False, False])
    assert "k = 0 N/m, c = 1: Contact 'floor': stiffness is 0, not positive" in ensemble.messages[0]
    refused(r"\(k = 0 N/m, c = 1\)", mb.simulate, scene, parameters={"k": 0.0}, error=mb.SimulationError)


def test_rotations_and_spins_may_depend_on_parameters():
    p = mb.Parameters(tilt=0.4, spin=3.0, r=0.5)
    top = mb.Body("top", 1.0, (1, 1, 1), mb.Spatial())
    tip = mb.Spherical("tip", GROUND.point(0, 0), top.point(0, 0, -p.r))
    rotation = mb.rotation((0, 1, 0), p.tilt) @ mb.rotation((0, 0, 1), 0.2)
    scene = mb.Scene(mb.System(top, tip, parameters=p), {"top.rotation": rotation, "top.omega": (0, p.tilt, p.spin)})
    start, x = started(scene, [[0.4, 3.0, 0.5], [1.0, -2.0, 0.3]])
    tilt, r = np.array([0.4, 1.0]), np.array([0.5, 0.3])
    assert_allclose(x["top.x"], r * np.sin(tilt), atol=1e-14)
    assert_allclose(x["top.z"], r * np.cos(tilt), atol=1e-14)
    assert_allclose(x["top.e0"], np.cos(tilt / 2) * np.cos(0.1), atol=1e-14)
    assert_array_equal(x["top.omega_z"], [3.0, -2.0])
    assert_array_equal(x["top.omega_x"], 0.0)
    assert start.listed == ("top.rotation", "top.omega")


def test_all_samples_start_on_the_branch_of_the_nominal_one():
    """Crank-rocker: the coupler's pin lies above the line of the pivots for the nominal crank and every sample."""
    p = mb.Parameters(crank=0.3, coupler=0.9, angle=0.5)
    bodies = [mb.Body(name, 1.0, 0.1, mb.Planar()) for name in ("crank", "coupler", "rocker")]
    crank, coupler, rocker = bodies
    system = mb.System(
        *bodies,
        mb.Revolute("A", GROUND.point(0, 0), crank.point(0, 0)),
        mb.Revolute("B", crank.point(p.crank, 0), coupler.point(0, 0)),
        mb.Revolute("C", coupler.point(p.coupler, 0), rocker.point(0.7, 0)),
        mb.Revolute("D", GROUND.point(1.0, 0), rocker.point(0, 0)),
        parameters=p,
    )
    rng = np.random.default_rng(2)
    samples = np.array([0.3, 0.9, 0.5]) + rng.uniform(-1, 1, (200, 3)) * [0.05, 0.1, 2.5]
    below = {"coupler.theta": -0.9, "rocker.theta": -1.5}
    for guess, sign in (({"coupler.theta": 0.9, "rocker.theta": 1.5}, 1), (below, -1)):
        start, x = started(mb.Scene(system, {"crank.theta": p.angle}, guess=guess), samples)
        assert (sign * np.sin(x["rocker.theta"]) > 0.1).all()
        assert "crank.theta" not in start.solved and "rocker.theta" in start.solved


def test_a_drive_sets_the_start_at_its_own_time():
    """x = sin(2 t) from t0 = 0.6 on: position and velocity are those of that time."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Motion("drive", ball.x, ca.sin(2 * mb.t)), mb.Gravity(0, -9.81))
    scene = mb.Scene(system, {"ball.y": 1.0, "ball.vy": 2.0}, np.linspace(0.6, 1.6, 6))
    _, x = started(scene)
    assert_allclose(x["ball.x"], np.sin(1.2))
    assert_allclose(x["ball.vx"], 2 * np.cos(1.2))
    run = mb.simulate(scene, mb.CVODES(rtol=1e-11))
    assert_allclose(run["ball.x"], np.sin(2 * run.t), atol=1e-9)
    assert_allclose(run["ball.y"], 1 + 2 * (run.t - 0.6) - 9.81 / 2 * (run.t - 0.6) ** 2, atol=1e-9)
    assert_allclose(run["drive.lam[0]"], 4 * np.sin(2 * run.t), atol=1e-8)  # m x'' + lam = 0
    with pytest.raises(mb.AssemblyError, match=r"residual .* in joint 'drive'"):
        mb.DAESimulator(mb.Scene(system, {"ball.x": 0.0}, [0.6]))


CONTRADICTIONS = {
    "position": (
        {"rod.theta": 0.3, "rod.x": 0.5},
        r"Phi = 0: the residual is .* in joint 'hinge'\. Remove one of rod\.theta, rod\.x from start",
    ),
    "everything": (
        {"rod.theta": 0.3, "rod.x": 0.0, "rod.y": 0.0},
        r"residual .* in joint 'hinge'\. Remove rod\.theta and rod\.y from start",
    ),
    "out of reach": ({"rod.x": 0.7}, r"residual is 0\.1 in joint 'hinge'"),
    "velocity": (
        {"rod.theta": 0.3, "rod.omega": 1.0, "rod.vx": 0.0},
        r"start velocities contradict the constraints: .* rate .* in joint 'hinge'\. Remove one of rod\.omega, rod\.vx",
    ),
    "all velocities": ({"rod.omega": 1.0, "rod.vx": 1.0, "rod.vy": 1.0}, r"velocities contradict .* in joint 'hinge'"),
}


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_a_start_that_contradicts_the_constraints_names_the_joint(case):
    system, _ = pendulum()
    listed, text = CONTRADICTIONS[case]
    refused(text, mb.DAESimulator, mb.Scene(system, listed), error=mb.AssemblyError)


def test_listed_values_may_be_redundant_where_they_agree():
    system, p = pendulum()
    listed = {"rod.theta": 0.3, "rod.x": p.l / 2 * np.sin(0.3), "rod.omega": 1.0, "rod.vx": p.l / 2 * np.cos(0.3)}
    start, x = started(mb.Scene(system, listed), P)
    assert start.solved == ("rod.y",)
    assert_array_equal(x["rod.x"], [row[0] / 2 * np.sin(0.3) for row in P])


def test_a_sample_whose_listed_values_contradict_fails_alone():
    system, p = pendulum()
    scene = mb.Scene(system, {"rod.theta": 0.3, "rod.x": 0.6 * np.sin(0.3) * (1 + 0 * p.l)}, [0.0, 0.1])
    assert_array_equal(mb.DAESimulator(scene).run(np.array([[1.2, 0.0], [1.3, 0.0]])).ok, [True, False])


@pytest.mark.parametrize("heights", [(0.0,), (-0.5, 0.7)])
@pytest.mark.parametrize("names", [("y",), ("x", "y")])
@pytest.mark.parametrize("pose", [mb.Planar(), mb.Spatial()], ids=repr)
def test_listed_coordinates_of_a_body_that_cannot_move(pose, names, heights):
    """Samples that agree with the welds start, others fail alone."""
    p, at = mb.Parameters(shift=0.0), {"x": 0.37, "y": -0.21}
    door = mb.Body("door", 3.0, 0.4 if isinstance(pose, mb.Planar) else (0.4, 0.5, 0.6), pose)
    welds = [mb.Weld(f"weld{i}", GROUND.point(0, y), door.point(-at["x"], y - at["y"])) for i, y in enumerate(heights)]
    listed = {f"door.{name}": at[name] + p.shift for name in names}
    scene = mb.Scene(mb.System(door, *welds, parameters=p), listed, [0.0, 0.1])
    trajectory = mb.simulate(scene)
    assert_allclose([trajectory[f"door.{name}"] for name in at], [[value] * 2 for value in at.values()], atol=1e-15)
    assert_array_equal(mb.DAESimulator(scene).run(np.array([[0.0], [0.1]])).ok, [True, False])


@pytest.mark.parametrize(
    ("pose", "make"),
    [
        (mb.Planar(), lambda b: mb.Weld("clamp", GROUND.point(0, 0), b.point(0, 0))),
        (mb.Planar(), lambda b: mb.Prismatic("clamp", GROUND.point(0, 0), b.point(0, 0), axis=(1, 0, 0))),
        (mb.Spatial(), lambda b: mb.Revolute("clamp", GROUND.point(0, 0), b.point(0, 0), axis=(1, 0, 0))),
        (mb.Spatial(), lambda b: mb.Weld("clamp", GROUND.point(0, 0), b.point(0, 0))),
        (mb.Spatial(), lambda b: mb.PlanarJoint("clamp", GROUND.point(0, 0), b.point(0, 0), axis=(1, 0, 0))),
    ],
)
def test_a_flipped_root_is_an_error_that_names_the_joint(pose, make):
    """Turned by almost half a turn about z, the frames lock antiparallel."""
    planar = isinstance(pose, mb.Planar)
    body = mb.Body("b", 1.0, 1.0 if planar else (1, 1, 1), pose)
    guess = {"b.theta": 3.0} if planar else {"b.rotation": mb.rotation((0, 0, 1), 3.0)}
    with pytest.raises(mb.AssemblyError, match=r"'clamp' is assembled the wrong way round: .* Give a better guess="):
        mb.DAESimulator(mb.Scene(mb.System(body, make(body)), guess=guess), mb.DormandPrince())


def test_points_that_coincide_at_the_guess_are_told():
    """A Distance has no direction there."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Distance("rope", GROUND.point(0, 0), ball.point(0, 0), 2.0), mb.Gravity(0, 0, -1))
    with pytest.raises(mb.AssemblyError, match=r"Joint 'rope' is singular at the guess: .* Give a better guess="):
        mb.DAESimulator(mb.Scene(system))


def hinges(pose, offset):
    inertia = 1.0 if isinstance(pose, mb.Planar) else (1, 1, 1)
    door, frame = mb.Body("door", 1.0, inertia, pose), mb.Body("frame", 1.0, inertia, pose)
    z = (0, 0) if isinstance(pose, mb.Planar) else (0, offset)
    return mb.System(
        door, frame,
        mb.Weld("wall", GROUND.point(0, 0), frame.point(0, 0)),
        mb.Revolute("lower", frame.point(0, 0, z[0]), door.point(0, 0, z[0])),
        mb.Revolute("upper", frame.point(0, 0, z[1]), door.point(0, 0, z[1])),
    )  # fmt: skip


UPRIGHT = {"left.y": 0.5, "coupler.x": 1.0, "coupler.y": 1.0, "right.x": 2.0, "right.y": 0.5}


@pytest.mark.parametrize(
    ("system", "guess", "kept", "named"),
    [
        (four_bar(mb.Spatial()), UPRIGHT, 17, ("A", "B", "C", "D")),
        (hinges(mb.Planar(), 0), {}, 5, ("lower", "upper")),
        (hinges(mb.Spatial(), 1.0), {}, 11, ("lower", "upper")),
    ],
)
def test_redundant_constraints_are_left_out_and_named(system, guess, kept, named):
    simulator = mb.DAESimulator(mb.Scene(system, guess=guess), mb.DormandPrince())
    assert simulator.start.redundant == named
    assert simulator.dae.n_r == len(simulator.start.rows) == kept


@pytest.mark.parametrize(
    "solver",
    [mb.CVODES(), mb.IDAS(), mb.DormandPrince(), pytest.param(mb.GeneralizedAlpha(1e-4), marks=pytest.mark.long)],
    ids=repr,
)
def test_a_redundant_loop_in_space_moves_as_it_does_in_the_plane(solver):
    times = np.linspace(0, 0.5, 11)
    runs = [
        mb.simulate(mb.Scene(four_bar(pose), start, times, guess=UPRIGHT), solver=solver)
        for pose, start in (
            (mb.Planar(), {"left.theta": -0.3}),
            (mb.Spatial(), {"left.rotation": mb.rotation((0, 0, 1), -0.3)}),
        )
    ]
    for name in ("left.x", "coupler.y", "right.x", "right.vy"):
        assert_allclose(runs[0][name], runs[1][name], atol=1e-7)
    for joint in "ABCD":
        assert_allclose(runs[0].reaction(joint)[0], runs[1].reaction(joint)[0], atol=1e-4)
    assert runs[1].position_drift < 1e-8


def test_redundant_joints_share_their_load_with_least_reactions():
    """Two hinges 1 m above and below the middle of a door on them: either carries half its weight."""
    door = mb.Body("door", 3.0, (1.0, 1.0, 1.0), mb.Spatial())
    heights = (("lower", -1.0), ("upper", 1.0))
    joints = [mb.Revolute(name, GROUND.point(0, 0, z), door.point(0, -0.5, z)) for name, z in heights]
    run = mb.simulate(mb.Scene(mb.System(door, *joints, mb.Gravity(0, 0, -9.81)), times=np.linspace(0, 0.1, 3)))
    for joint in ("lower", "upper"):
        assert_allclose(run.reaction(joint)[0][0, 2], 1.5 * 9.81, rtol=1e-9)
    assert run.drift.position.max() < 1e-12
    assert "smallest reactions" in str(run)


def test_a_singular_start_is_told():
    """All links of the parallel four-bar in a line: it may go on as a parallelogram or as a kite."""
    guess = {"left.x": 0.5, "coupler.x": 2.0, "right.x": 2.5, "left.theta": -np.pi / 2, "right.theta": -np.pi / 2}
    scene = mb.Scene(four_bar(mb.Planar()), {"left.theta": -np.pi / 2}, guess=guess)
    told = r"singular position.* rank of the 8 constraint rows is 7 at the start, but 8 close to"
    refused(told, mb.DAESimulator, scene, error=mb.AssemblyError)


def test_a_planar_four_bar_is_not_redundant_off_its_singular_position():
    start, x = started(mb.Scene(four_bar(mb.Planar()), {"left.theta": -0.3}, guess=UPRIGHT))
    assert_allclose(x["right.theta"], -0.3, atol=1e-12)
    assert_allclose(x["coupler.theta"], 0, atol=1e-12)
    assert len(start.solved) == 8


@pytest.mark.parametrize("length", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("solver", [None, mb.CVODES(stiff=True), mb.IDAS(), mb.DormandPrince()], ids=repr)
def test_a_bar_whose_frame_is_its_hinge_is_as_large_as_its_lever_arm(solver, length):
    """Its coordinates start at what Newton's method leaves of zero, which is no length to measure errors by."""
    bar = mb.Body("bar", 1.0, 0.1 * length**2, mb.Planar())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), bar.point(0, 0))
    pull = mb.Motion("pull", bar.point(length, 0).x, length * (0.5 + mb.t / 10))
    times = np.linspace(0, 2, 9)
    scene = mb.Scene(mb.System(bar, hinge, pull), {}, times, {"angle": bar.theta}, guess={"bar.theta": 1.0})
    run = mb.simulate(scene, solver)
    assert run.program.bodies.dae.scales.length == pytest.approx(length, rel=0.1)
    assert_allclose(run["angle"], np.arccos(0.5 + 0.1 * times), rtol=1e-8)


@pytest.mark.parametrize("length", [1e-9, 1e9])
def test_assemblies_of_any_size_are_checked(length):
    """A rod of that length reaches a wall at 0.8 of it, from a guess as far off as its size, and none at 1.5."""
    p = mb.Parameters(share=0.8)
    rod = mb.Body("rod", 1.0, 0.1 * length**2, mb.Planar())
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), rod.point(-length / 2, 0))
    wall = mb.Motion("wall", rod.point(length / 2, 0).x, p.share * length + 0 * mb.t)
    scene = mb.Scene(mb.System(rod, hinge, wall, parameters=p), {}, [0.0, 1.0], guess={"rod.theta": 1.0})
    start, at = started(scene)
    assert not start.redundant
    assert_allclose([at["rod.theta"][0], at["rod.x"][0] / length], [np.arccos(0.8), 0.4])
    x, reasons = start.states(np.array([[0.5], [1.5]]))
    assert reasons == ("", "the start could not be computed") and np.isnan(x[1]).all()


@pytest.mark.parametrize("speed", [1e-15, 1e-6, 1.0])
def test_motions_from_the_origin_are_as_large_as_their_first_way(speed):
    """An oscillator of 1 rad/s, of which nothing but the speed tells an amplitude."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Spring("spring", GROUND.point(0, 0), ball.point(0, 0), 1.0))
    scene = mb.Scene(system, {"ball.vx": speed}, np.linspace(0, 10, 11), {"x": ball.x})
    for values in (mb.simulate(scene)["x"], mb.DAESimulator(scene).run(np.zeros((1, 0))).Y[0, :, 0]):
        assert_allclose(values / speed, np.sin(scene.times), atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_samples_start_as_scenes_with_these_nominal_values(seed):
    """Nothing is listed: carriers keep their places, and the bodies on them move with the parameters."""
    rng = np.random.default_rng(seed)
    nominal, other = rng.uniform(0.05, 0.1, 3), rng.uniform(0.05, 0.1, 3)

    def scene(values):
        p = mb.Parameters(**dict(zip("abc", values.tolist(), strict=True)))
        box, rotor, arm = (mb.Body(name, mass, 0.1) for name, mass in (("box", 120.0), ("rotor", 1.5), ("arm", 300.0)))
        rail = mb.Prismatic("rail", GROUND.point(0, 0), box.point(0, 0), axis=(1, 0, 0))
        shaft = mb.Revolute("shaft", box.point(0, p.a), rotor.point(-p.b, 0))
        elbow = mb.Revolute("elbow", rotor.point(p.b, 0), arm.point(-p.c, 0))
        motor = mb.Motion("motor", shaft.angle, 10 * mb.t)
        bodies = [rotor, arm, box] if seed % 2 else [box, rotor, arm]
        return mb.Scene(mb.System(*bodies, rail, shaft, elbow, motor, parameters=p), times=[0.0, 0.1])

    at_nominal, sample = (
        mb.simulate(scene(other)),
        mb.simulate(scene(nominal), parameters=dict(zip("abc", other, strict=True))),
    )
    for name in ("box.x", "rotor.x", "rotor.y", "arm.x", "arm.theta"):
        assert_allclose(sample[name], at_nominal[name], atol=1e-8)
    assert sample["box.x"][0] == 0
