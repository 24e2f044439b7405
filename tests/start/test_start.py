"""Starting: what is listed holds exactly, the rest follows from the constraints on one assembly branch."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from faults import refused, warned
from joints import numbers
from machines import GROUND, ORIGIN, ball, bob, bouncing_ball, free_body, linkage, pendulum, rods
from machines import ball as falling
from mechanisms import four_bar
from numpy.testing import assert_allclose, assert_array_equal
from test_start_velocities import cart

import symmb as mb
from symmb.run.events import event_doubts


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


rod = partial(pendulum, length=0.6, g=None, tilt=0.3)


ROPE = partial(bob, mb.Gravity(0, 0, -1), length=2.0, g=None)
P = [[0.6, 1.0, 0.1, 0.3], [0.35, 1.0, 0.1, -1.0], [0.5, 1.0, 0.1, 2.0]]


def test_listed_values_hold_exactly_and_the_others_follow():
    machine = rod()
    start, x = started(machine.scene(start={"rod.theta": machine.p.tilt, "rod.omega": 2 * machine.p.length}), P)
    lengths, _, _, tilts = np.array(P).T
    assert_array_equal([x["rod.theta"], x["rod.omega"]], [tilts, 2 * lengths])
    known = [lengths * np.sin(tilts), 2 * lengths**2 * np.cos(tilts)]
    assert_allclose([x["rod.y"], x["rod.vy"]], known, atol=1e-14)
    assert (start.listed, start.solved, start.free) == (("rod.theta", "rod.omega"), ("rod.x", "rod.y"), ())


@pytest.mark.parametrize(("guess", "sign"), [(0.4, 1), (-0.4, -1), (np.pi - 0.4, 1), (0.0, None)])
def test_the_guess_picks_the_branch(guess, sign):
    """With x listed, the rod may lean up or down; straight along x the slope vanishes and nothing is found."""
    machine = rod()
    scene = machine.scene(start={"rod.x": machine.p.length * ca.cos(0.3)}, guess={"rod.theta": guess})
    if sign is None:
        refused(r"'hinge'.* better guess", mb.DAESimulator, scene, error=mb.AssemblyError)
        return
    _, x = started(scene, P)
    assert_allclose(np.sin(x["rod.theta"]), sign * np.sin(0.3), atol=1e-12)
    assert_array_equal(x["rod.x"], [row[0] * np.cos(0.3) for row in P])


def test_what_the_constraints_leave_open_stays_at_its_guess():
    """A ball on a rod: the least move from the guess is along the line to the anchor."""
    start, x = started(ROPE().scene(guess={"bob.x": 3.0, "bob.y": 4.0}))
    assert_allclose([x["bob.x"][0], x["bob.y"][0], x["bob.z"][0]], [1.2, 1.6, 0], atol=1e-12)
    assert len(start.solved) == 1 and len(start.free) == 2 and start.listed == ()


def test_defaults_are_zero_and_the_identity_rotation():
    scene = free_body(mb.Gravity(0, 0, -1)).scene(times=[0.0])
    simulator = mb.DAESimulator(scene)
    assert_array_equal(simulator.start.states(simulator.dae.p_nominal[None])[0], [[0, 0, 0, 1, *[0] * 9]])
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
    run = rod().run(times=[0.0], guess={"rod.theta": 1.0, "rod.x": 0.5})
    assert f"left free rod.theta = {run['rod.theta'][0]:.6g}" in str(run)
    assert "held" not in str(run)  # nothing is listed


def test_velocities_are_told_as_positions_are():
    """A rod on a cart: nothing determines its rate, and the rail and the pin determine all others."""
    run = mb.simulate(mb.Scene(cart(), {"cart.x": 0.0, "cart.vx": 1.0, "rod.theta": 0.3}))
    line = next(line for line in str(run).split("\n") if line.startswith("  start"))
    assert "held cart.x, cart.vx, rod.theta; solved for" in line
    assert line.endswith("rod.y, cart.vy, cart.omega, rod.vx, rod.vy; left free rod.omega = 0")


def test_masses_and_lengths_must_be_positive_for_every_sample():
    system = bob(length=1.0, mass=2.0).system
    scene = mb.Scene(system, guess={"bob.y": -1.0}, times=[0.0, 0.5])
    told = r"Body 'bob': mass is -2, not positive"
    refused(told, mb.simulate, scene, parameters={"mass": -2.0}, error=mb.SimulationError)
    ensemble = mb.DAESimulator(scene).run(np.array([[1.0, 2.0, 9.81], [-1.0, 2.0, 9.81], [1.0, -1.0, 9.81]]))
    assert_array_equal(ensemble.ok, [True, False, False])
    assert "Distance 'rod': length is -1, not positive" in ensemble.messages[0]
    refused(r"box: Body 'bob': mass is -1, not positive, at mass = -1", scene.with_box, mb.Box(mass=(-1, 3)))


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
    known = [r * np.sin(tilt), r * np.cos(tilt), np.cos(tilt / 2) * np.cos(0.1)]
    assert_allclose([x[f"top.{name}"] for name in ("x", "z", "e0")], known, atol=1e-14)
    assert_array_equal([x["top.omega_z"], x["top.omega_x"]], [[3.0, -2.0], [0.0, 0.0]])
    assert start.listed == ("top.rotation", "top.omega")


def test_all_samples_start_on_the_branch_of_the_nominal_one():
    """Crank-rocker: the coupler's pin lies above the line of the pivots for the nominal crank and every sample."""
    bars = linkage(lengths=(0.3, 0.9, 0.7, 1.0), angle=0.5)
    samples = np.tile([*bars.p.values()], (200, 1))
    samples[:, [0, 1, -1]] += np.random.default_rng(2).uniform(-1, 1, (200, 3)) * [0.05, 0.1, 2.5]
    below = {"coupler.theta": -0.9, "rocker.theta": -1.5}
    for guess, sign in (({"coupler.theta": 0.9, "rocker.theta": 1.5}, 1), (below, -1)):
        start, x = started(bars.scene(start={"crank.theta": bars.p.angle}, guess=guess), samples)
        assert (sign * np.sin(x["rocker.theta"]) > 0.1).all()
        assert "crank.theta" not in start.solved and "rocker.theta" in start.solved


def test_a_drive_sets_the_start_at_its_own_time():
    """x = sin(2 t) from t0 = 0.6 on: position and velocity are those of that time."""
    system = falling(lambda m: mb.Motion("drive", m.ball.x, ca.sin(2 * mb.t))).system
    scene = mb.Scene(system, {"ball.y": 1.0, "ball.vy": 2.0}, np.linspace(0.6, 1.6, 6))
    _, x = started(scene)
    assert_allclose([x["ball.x"], x["ball.vx"]], [[np.sin(1.2)], [2 * np.cos(1.2)]])
    run = mb.simulate(scene, mb.CVODES(rtol=1e-11))
    assert_allclose(run["ball.x"], np.sin(2 * run.t), atol=1e-9)
    assert_allclose(run["ball.y"], 1 + 2 * (run.t - 0.6) - 9.81 / 2 * (run.t - 0.6) ** 2, atol=1e-9)
    assert_allclose(run["drive.lam[0]"], 4 * np.sin(2 * run.t), atol=1e-8)  # m x'' + lam = 0
    scene = mb.Scene(system, {"ball.x": 0.0}, [0.6])
    refused(r"residual .* in joint 'drive'", mb.DAESimulator, scene, error=mb.AssemblyError)


CONTRADICTIONS = {
    r"Phi = 0: the residual is .* {}\. Remove one of rod\.theta, rod\.y from start": {"theta": 0.3, "y": 0.5},
    r"residual .* {}\. Remove rod\.theta and rod\.x from start": {"theta": 0.3, "y": 0.0, "x": 0.0},
    "residual is 0.1 {}": {"y": 0.7},
    r"start velocities contradict the constraints: .* rate .* {}\. Remove one of rod\.omega, rod\.vy": {
        "theta": 0.3, "omega": 1.0, "vy": 0.0,
    },
    "velocities contradict .* {}": {"omega": 1.0, "vx": 1.0, "vy": 1.0},
}  # fmt: skip


@pytest.mark.parametrize("text", CONTRADICTIONS)
def test_a_start_that_contradicts_the_constraints_names_the_joint(text):
    listed = {f"rod.{name}": value for name, value in CONTRADICTIONS[text].items()}
    refused(text.format("in joint 'hinge'"), mb.DAESimulator, rod().scene(start=listed), error=mb.AssemblyError)


def test_listed_values_may_be_redundant_where_they_agree():
    machine, (s, c) = rod(), (np.sin(0.3), np.cos(0.3))
    listed = {"theta": 0.3, "y": machine.p.length * s, "omega": 1.0, "vy": machine.p.length * c}
    start, x = started(machine.scene(start={f"rod.{name}": value for name, value in listed.items()}), P)
    assert start.solved == ("rod.x",)
    assert_array_equal(x["rod.y"], [row[0] * s for row in P])


def test_a_sample_whose_listed_values_contradict_fails_alone():
    machine = rod()
    start = {"rod.theta": 0.3, "rod.y": 0.6 * np.sin(0.3) * (1 + 0 * machine.p.length)}
    simulator = mb.DAESimulator(machine.scene(times=[0.0, 0.1], start=start))
    assert_array_equal(simulator.run(np.array([P[0], [0.65, *P[0][1:]]])).ok, [True, False])


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
    ("pose", "kind"),
    [
        *((mb.Planar(), kind) for kind in (mb.Weld, mb.Prismatic)),
        *((mb.Spatial(), kind) for kind in (mb.Revolute, mb.Weld, mb.PlanarJoint)),
    ],
)
def test_a_flipped_root_is_an_error_that_names_the_joint(pose, kind):
    """Turned by almost half a turn about z, the frames lock antiparallel."""
    planar = isinstance(pose, mb.Planar)
    body = mb.Body("b", 1.0, 1.0 if planar else (1, 1, 1), pose)
    clamp = kind("clamp", GROUND.point(0, 0), body.point(0, 0), **({} if kind is mb.Weld else {"axis": (1, 0, 0)}))
    guess = {"b.theta": 3.0} if planar else {"b.rotation": mb.rotation((0, 0, 1), 3.0)}
    told = r"'clamp' is assembled the wrong way round: .* Give a better guess="
    refused(told, started, mb.Scene(mb.System(body, clamp), guess=guess), error=mb.AssemblyError)


def test_points_that_coincide_at_the_guess_are_told():
    """A Distance has no direction there."""
    told = r"Joint 'rod' is singular at the guess: .* Give a better guess="
    refused(told, mb.DAESimulator, ROPE().scene(), error=mb.AssemblyError)


def hinges(pose, offset):
    door, frame = (mb.Body(n, 1.0, 1.0 if isinstance(pose, mb.Planar) else (1, 1, 1), pose) for n in ("door", "frame"))
    heights = (("lower", 0), ("upper", offset))
    joints = [mb.Revolute(name, frame.point(0, 0, z), door.point(0, 0, z)) for name, z in heights]
    return mb.System(door, frame, mb.Weld("wall", GROUND.point(0, 0), frame.point(0, 0)), *joints)


UPRIGHT = {"left.y": 0.5, "coupler.x": 1.0, "coupler.y": 1.0, "right.x": 2.0, "right.y": 0.5}


@pytest.mark.parametrize(
    ("system", "guess", "kept", "named"),
    [
        (lambda: four_bar(mb.Spatial()), UPRIGHT, 17, ("A", "B", "C", "D")),
        (lambda: hinges(mb.Planar(), 0), {}, 5, ("lower", "upper")),
        (lambda: hinges(mb.Spatial(), 1.0), {}, 11, ("lower", "upper")),
    ],
)
def test_redundant_constraints_are_left_out_and_named(system, guess, kept, named):
    simulator = mb.DAESimulator(mb.Scene(system(), guess=guess), mb.DormandPrince())
    assert simulator.start.redundant == named
    assert simulator.dae.n_r == len(simulator.start.rows) == kept


@pytest.mark.parametrize(
    "solver",
    [mb.CVODES(), mb.IDAS(), mb.DormandPrince(), pytest.param(mb.GeneralizedAlpha(1e-4), marks=pytest.mark.long)],
    ids=repr,
)
def test_a_redundant_loop_in_space_moves_as_it_does_in_the_plane(solver):
    times = np.linspace(0, 0.5, 11)
    leans = {mb.Planar(): {"left.theta": -0.3}, mb.Spatial(): {"left.rotation": mb.rotation((0, 0, 1), -0.3)}}
    scenes = [mb.Scene(four_bar(pose), start, times, guess=UPRIGHT) for pose, start in leans.items()]
    runs = [mb.simulate(scene, solver=solver) for scene in scenes]
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
    pull = lambda m: mb.Motion("pull", m.rod.point(length, 0).x, length * (0.5 + mb.t / 10))  # noqa: E731
    bar, times = pendulum(pull, length=0.0, inertia=0.1 * length**2, g=None), np.linspace(0, 2, 9)
    run = bar.run("theta", times, solver=solver, guess={"rod.theta": 1.0})
    assert run.program.bodies.dae.scales.length == pytest.approx(length, rel=0.1)
    assert_allclose(run["theta"], np.arccos(0.5 + 0.1 * times), rtol=1e-8)


@pytest.mark.parametrize("length", [1e-9, 1e9])
def test_assemblies_of_any_size_are_checked(length):
    """A rod of that length reaches a wall at 0.8 of it, from a guess as far off as its size, and none at 1.5."""
    wall = lambda m: mb.Motion("wall", m.rod.point(length / 2, 0).x, m.p.share * length + 0 * mb.t)  # noqa: E731
    machine = pendulum(wall, length=length / 2, inertia=0.1 * length**2, g=None, share=0.8)
    start, at = started(machine.scene(guess={"rod.theta": 1.0}))
    assert not start.redundant
    assert_allclose([at["rod.theta"][0], at["rod.x"][0] / length], [np.arccos(0.8), 0.4])
    x, reasons = start.states(np.array([[*machine.p.values()][:-1] + [share] for share in (0.5, 1.5)]))
    assert reasons == ("", "the start could not be computed") and np.isnan(x[1]).all()


@pytest.mark.parametrize("speed", [1e-15, 1e-6, 1.0])
def test_motions_from_the_origin_are_as_large_as_their_first_way(speed):
    """An oscillator of 1 rad/s, of which nothing but the speed tells an amplitude."""
    scene = falling(lambda m: mb.Spring("spring", ORIGIN, m.at, 1.0), g=None).scene(
        "x", np.linspace(0, 10, 11), {"ball.vx": speed}
    )
    simulator = mb.DAESimulator(scene)
    for values in (mb.simulate(scene)["x"], simulator.run(simulator.dae.p_nominal[None]).Y[0, :, 0]):
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

    at_nominal = mb.simulate(scene(other))
    sample = mb.simulate(scene(nominal), parameters=dict(zip("abc", other, strict=True)))
    for name in ("box.x", "rotor.x", "rotor.y", "arm.x", "arm.theta"):
        assert_allclose(sample[name], at_nominal[name], atol=1e-8)
    assert sample["box.x"][0] == 0


# What is doubtful about a start is told in sentences.


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
