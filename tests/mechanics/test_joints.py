"""Every joint with every pose it admits: rows as many as theory says, derivatives equal to finite differences.

Angles and displacements of joints against SciPy's rotations, their rates against differences along a motion.
"""

import casadi as ca
import numpy as np
import pytest
from conftest import ALL_JOINTS
from faults import refused
from joints import KINDS, OTHER, SKEW, bundle, coast, derivative, make_body, numbers, random_state
from machines import GROUND, ORIGIN, run_of
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import symmb as mb
from symmb.equations.model import units_of

PAIRS = [(a, b) for a in KINDS for b in KINDS if (a, b) != ("Ground", "Ground")]
ADMITTED = [pytest.param(j, a, b, id=f"{j.name}-{a}-{b}") for j in ALL_JOINTS for a, b in PAIRS if j.admits(a, b)]
REFUSED = [pytest.param(j, a, b, id=f"{j.name}-{a}-{b}") for j in ALL_JOINTS for a, b in PAIRS if not j.admits(a, b)]


def declared(joint, a, b):
    bodies = make_body(a, "a"), make_body(b, "b")
    return bundle(*bodies, joint.between(*bodies))


def arguments(dae, q, v, time=0.3):
    """(q, v[, s], p, t) with states where they start, so that no turn has been counted."""
    s = (numbers(dae.s_start, q, []),) if dae.n_s else ()
    return (q, v, *s, dae.p_nominal, time)


def assert_derivatives(system, dae, seed):
    """Phi_q, Phi_t, G and gamma of a system against differences of Phi at a random state."""
    rng = np.random.default_rng(seed)
    q, v = random_state(dae, rng)
    eye, at = np.eye(dae.n_q), arguments(dae, q, v)

    def Phi(q, time=0.3):
        return numbers(dae.Phi, q, *at[1:-1], time)

    columns = [derivative(lambda h, e=e: Phi(q + h * e)) for e in eye]
    assert_allclose(dae.Phi_q(*at).full(), np.transpose(columns), atol=1e-9)
    N = ca.Function("N", [system.q], [system.N])(q).full()
    assert_allclose(dae.G(*at).full(), dae.Phi_q(*at).full() @ N, atol=1e-13)
    Phi_t = derivative(lambda h: Phi(q, 0.3 + h))
    assert_allclose(numbers(dae.Phi_t, *at) if dae.Phi_t else 0 * Phi_t, Phi_t, atol=1e-9)

    def along(h):  # a motion with constant velocities: the second derivative of Phi is -gamma
        return Phi(coast(dae, q, v, h), 0.3 + h)

    assert_allclose(numbers(dae.Phi_dot, *at), derivative(along), atol=1e-9)
    assert_allclose(numbers(dae.gamma, *at), -derivative(along, 2), atol=2e-8)


@pytest.mark.parametrize(("joint", "a", "b"), ADMITTED)
def test_a_joint_has_the_rows_theory_gives_it_and_their_derivatives(joint, a, b):
    system, dae = declared(joint, a, b)
    assert_derivatives(system, dae, seed=1)
    # The other side of a planar body may leave the plane, so that all rows stay.
    expected = joint.planar_rows if {a, b} <= {"Planar", "Ground"} else joint.spatial_rows
    assert system.Phi.numel() == expected
    assert system.Phi_q.shape == (expected, system.q.numel())


@pytest.mark.parametrize(("joint", "a", "b"), REFUSED)
def test_bodies_that_make_no_sense_are_refused_by_name(joint, a, b):
    refused(rf"{joint.name} 'joint': body '[ab]' has .*, which cannot be used\. Use ", declared, joint, a, b)


@pytest.mark.parametrize("joint", ALL_JOINTS, ids=lambda j: j.name)
def test_both_points_on_one_body_or_on_the_ground_are_refused(joint):
    body = make_body("Spatial", "a")
    refused("both points are on body 'a'", bundle, body, joint.between(body, body))
    refused("both points are on the ground", bundle, body, joint.between(mb.Ground(), mb.Ground()))


@pytest.mark.parametrize(("joint", "a", "b"), ADMITTED)
def test_rows_are_independent_where_the_joint_is_assembled(joint, a, b):
    bodies = make_body(a, "a"), make_body(b, "b")
    guess = {f"{body.name}.x": 0.3 for body in bodies if body.name in "ab"}
    scene = mb.Scene(mb.System(*bodies, joint.between(*bodies)), guess=guess)
    simulator = mb.DAESimulator(scene, mb.DormandPrince())  # redundant rows would be an AssemblyError
    dae, ((x,), _) = simulator.dae, simulator.start.states(np.zeros((1, 0)))
    at = arguments(dae, x[: dae.n_q], np.zeros(dae.n_v))
    assert np.abs(numbers(dae.Phi, *at)).max() < 1e-12
    assert np.linalg.matrix_rank(dae.G(*at).full()) == dae.n_c


LAWS = [(mb.t**3 - 2 * mb.t, 0.7**3 - 2 * 0.7), (ca.sin(3 * mb.t), np.sin(3 * 0.7))]


@pytest.mark.parametrize(("law", "value"), LAWS, ids=["polynomial", "harmonic"])
def test_a_drive_of_any_position_expression(law, value):
    body, arm = make_body("Spatial", "a"), make_body("Planar", "b")
    driven = body.point(0.1, 0.2, 0.3).x * arm.theta + ca.sin(arm.y)
    system, dae = bundle(body, arm, mb.Motion("drive", driven, law))
    assert system.Phi.numel() == 1
    assert_derivatives(system, dae, seed=2)
    assert_allclose(numbers(dae.Phi, np.eye(7 + 3)[3], np.zeros(9), [], 0.7), -value)


def test_a_hinge_s_angle_may_be_driven_and_axes_may_contain_parameters():
    p, a, b = mb.Parameters(skew=0.1), make_body("Spatial", "a"), make_body("Spatial", "b")
    hinge = mb.Revolute("hinge", GROUND.point(0, 0, 0), b.point(0.3, 0, 0), axis=(1, 2, -1))
    system, dae = bundle(b, hinge, mb.Motion("drive", hinge.angle, mb.t**2))
    assert (dae.n_c, dae.n_s) == (6, 1)
    assert_derivatives(system, dae, seed=3)
    hinge = mb.Revolute("hinge", a.point(0, 0.1, 0), b.point(0.3, 0, 0), axis=(p.skew, 0, 1), axis_b=(0, 1, p.skew))
    assert_derivatives(*bundle(a, b, hinge, parameters=p), seed=4)


def test_a_velocity_row_adds_to_G_and_gamma_but_not_to_Phi():
    """Skate: the velocity across the blade vanishes, -sin(theta) vx + cos(theta) vy = 0."""
    skate = make_body("Planar", "skate")
    across = -ca.sin(skate.theta) * skate.vx + ca.cos(skate.theta) * skate.vy
    system, dae = bundle(skate, mb.VelocityConstraint("blade", (across,)))
    assert (system.Phi.numel(), dae.n_r, dae.Phi) == (0, 1, None)
    q, v = np.array([0.3, -0.2, 0.7]), np.array([1.1, 0.4, -2.0])
    c, s = np.cos(0.7), np.sin(0.7)
    assert_allclose(dae.G(q, v, [], 0.0).full(), [[-s, c, 0]])
    assert_allclose(numbers(dae.gamma, q, v, [], 0.0), -v[2] * (-c * v[0] - s * v[1]))


ABOUT_Z = "can turn about z only"
FAULTS = [
    (lambda a, b: mb.Revolute("elbow", a, b, (1, 0, 0)), "Planar", rf"{ABOUT_Z}, but the axis is \(1, 0, 0\)"),
    (lambda a, b: mb.Revolute("elbow", a, b, axis_b=(0, 1, 0)), "Planar", rf"{ABOUT_Z}, but the axis is \(0, 1, 0\)"),
    (lambda a, b: mb.Prismatic("elbow", a, b), "Planar", r"xy plane only, but the axis is \(0, 0, 1\)"),
    (lambda a, b: mb.PointOnLine("elbow", a, b), "Planar", r"needs an axis with z = 0, but the axis is \(0, 0, 1\)"),
    (lambda a, b: mb.Gear("elbow", a, b, axis=(0, 1, 0), ratio=2), "Planar", "can turn about z only"),
    (lambda a, b: mb.Revolute("elbow", a, b, axis=(0, 0, 0)), "Spatial", "has no direction"),
    (lambda a, b: mb.Universal("elbow", a, b), "Spatial", "axis_b is missing"),
    (lambda a, b: mb.Distance("elbow", a, b, 0.0), "Spatial", "length is 0; it must be above 0.* Use Spherical"),
    (lambda a, b: mb.Distance("elbow", a, b, -1), "Spatial", "length is -1; it must be above 0"),
    (lambda a, b: mb.Revolute("elbow", a, "b"), "Spatial", "expected a point, got str"),
    (lambda a, b: mb.Revolute("elbow", a.body, b), "Spatial", r"expected a point, got Body\. Use body\.point"),
    (lambda a, b: mb.Screw("elbow", a, b, pitch="steep"), "Spatial", "pitch: 'steep' is not a number"),
    (lambda a, b: mb.Revolute("elbow", a, b, axis=(0, 1)), "Planar", "can turn about z only"),
    (lambda a, b: mb.Revolute("elbow", a, b, axis=(0, 1, 0, 0)), "Spatial", "elbow.* has 4 components"),
]


@pytest.mark.parametrize(("joint", "poses", "text"), FAULTS)
def test_faults_of_a_joint_name_it(joint, poses, text):
    a, b = make_body(poses, "a"), make_body(poses, "b")
    refused(f"'elbow'.*{text}|{text}", mb.System, a, b, joint(a.point(0, 0), b.point(0, 0)))


SPATIAL = ("Spatial", "Ground")
TURNING = [
    (mb.Revolute, KINDS[:2] + KINDS[3:], {}, (0.4, 0.0)),
    (mb.Prismatic, KINDS[:2] + KINDS[3:], {}, (0.0, -0.7)),
    (mb.Cylindrical, SPATIAL, {}, (-2.9, 0.6)),
    (mb.Screw, SPATIAL, {"pitch": 0.5}, (1.3, 0.5 * 1.3 / (2 * np.pi))),
]
CASES = [
    pytest.param(joint, a, b, more, at, id=f"{joint.__name__}-{a}-{b}")
    for joint, kinds, more, at in TURNING
    for a in kinds
    for b in kinds
    if (a, b) != ("Ground", "Ground")
]
SLIDES = (mb.Prismatic, mb.Cylindrical, mb.Screw)
TURNS = (mb.Revolute, mb.Cylindrical, mb.Screw)


def with_axes(joint, a, b, more):
    """A joint away from the centres of mass, its axes, and whether one of its bodies is planar."""
    planar = "Planar" in (a, b)
    axes = (SKEW, OTHER) if not planar else ((0.6, 0.8, 0), (0, 1, 0)) if joint in SLIDES else ((0, 0, 1), (0, 0, 1))
    body_a, body_b = make_body(a, "a"), make_body(b, "b")
    z = (0,) if planar else (0.3,)
    return joint("joint", body_a.point(0.2, -0.1, *z), body_b.point(0.3, 0.4, *z), axis=axes[0], axis_b=axes[1], **more)


def pose_of(body, r, R):
    """Coordinates of a body by name, at a place and turned by a rotation."""
    if isinstance(body, mb.Ground):
        return {}
    if isinstance(body.pose, mb.Planar):
        return {"x": r[0], "y": r[1], "theta": R.as_rotvec()[2]}
    return dict(zip(("x", "y", "z", "e0", "e1", "e2", "e3"), [*r, *R.as_quat()[[3, 0, 1, 2]]], strict=True))


def values(expression, bodies, coordinates):
    """An expression of coordinates in numbers; states are at their starts."""
    q = ca.vertcat(*[body.frame.q for body in bodies])
    numbers = [coordinates[body.name][c] for body in bodies for c in body.pose.coordinates]
    s = [x for x in ca.symvar(expression) if x.name().endswith(".angle")]
    return np.asarray(ca.Function("f", [q, ca.vertcat(*s)], [expression])(numbers, np.zeros(len(s)))).ravel()


@pytest.mark.parametrize(("joint", "a", "b", "more", "at"), CASES)
def test_handles_measure_body_b_relative_to_body_a_in_the_joint_s_axis(joint, a, b, more, at):
    (angle, displacement), planar = at, "Planar" in (a, b)
    element = with_axes(joint, a, b, more)
    axis, axis_b = (np.array(x, dtype=float) / np.linalg.norm(x) for x in (element.axis, element.axis_b))
    R_a = Rotation.identity() if a == "Ground" else Rotation.from_rotvec((0, 0, 0.7) if planar else (0.3, -0.5, 0.4))
    r_a = np.zeros(3) if a == "Ground" else np.array([0.4, -0.3, 0.0 if planar else 0.8])
    normal = np.cross(axis_b, axis)
    turn = np.arccos(np.clip(axis @ axis_b, -1, 1))
    least = Rotation.from_rotvec(normal / max(np.linalg.norm(normal), 1e-300) * turn)
    R_b = Rotation.from_rotvec(angle * R_a.apply(axis)) * R_a * least
    s_a, s_b = (np.asarray(ca.DM(point.s)).ravel() for point in (element.point_a, element.point_b))
    r_b = r_a + R_a.apply(s_a) + displacement * R_a.apply(axis) - R_b.apply(s_b)
    if b == "Ground":  # the world turned and shifted so that b rests in it
        r_a, R_a = R_b.inv().apply(r_a - r_b), R_b.inv() * R_a
        r_b, R_b = np.zeros(3), Rotation.identity()
    bodies = [body for body in element.bodies() if isinstance(body, mb.Body)]
    poses = {"a": pose_of(element.point_a.body, r_a, R_a), "b": pose_of(element.point_b.body, r_b, R_b)}
    assert_allclose(values(mb.System(*bodies, element).Phi, bodies, poses), 0, atol=1e-14)
    if joint in TURNS:
        assert_allclose(values(element.angle, bodies, poses), angle, atol=1e-14)
    if joint in SLIDES:
        assert_allclose(values(element.displacement, bodies, poses), displacement, atol=1e-14)


@pytest.mark.parametrize(("joint", "a", "b", "more", "at"), CASES)
def test_rates_of_handles_are_those_of_a_motion_within_the_joint(joint, a, b, more, at):
    """The rate of the angle equals the slope of the angle only while the axes are parallel, as the joint has them."""
    element = with_axes(joint, a, b, more)
    bodies = [body for body in element.bodies() if isinstance(body, mb.Body)]
    system = mb.System(*bodies, element)
    scene = mb.Scene(system, guess={f"{body.name}.x": 0.3 for body in bodies})
    simulator = mb.DAESimulator(scene, mb.DormandPrince())  # with a given solver nothing is compiled
    dae, (x,) = simulator.dae, simulator.start.states(np.zeros((1, 0)))[0]
    q, G = x[: dae.n_q], dae.G(x[: dae.n_q], np.zeros(dae.n_v), *([x[-dae.n_s :]] if dae.n_s else []), [], 0.0).full()
    free = np.linalg.svd(G)[2][np.linalg.matrix_rank(G) :]
    v = free.T @ np.linspace(0.3, 0.9, len(free))
    s = ca.vertcat(*[record.sx for record in system.collected.states])
    handles = [(element.angle, element.angle_rate)] if joint in TURNS else []
    handles += [(element.displacement, element.displacement_rate)] if joint in SLIDES else []
    for handle, rate in handles:
        states = ca.vertcat(*[x for x in ca.symvar(handle) if x.name().endswith(".angle")])
        f = ca.Function("f", [system.q, states], [handle])
        no_turns = np.zeros(states.numel())
        slope = derivative(lambda h, f=f, s=no_turns: np.asarray(f(coast(dae, q, v, h), s)).ravel())
        exact = ca.Function("r", [system.q, system.v, s], [rate])(q, v, np.zeros(s.numel()))
        assert_allclose(slope, np.asarray(exact).ravel(), atol=2e-9)


@pytest.mark.parametrize("joint", SLIDES, ids=lambda j: j.__name__)
def test_the_rate_of_a_displacement_is_its_slope_along_every_motion(joint):
    element = with_axes(joint, "Spatial", "Spatial", {"pitch": 0.5} if joint is mb.Screw else {})
    assert_rate_of_displacement(mb.System(*element.bodies(), element), element, 2, 1e-9)


def assert_rate_of_displacement(system, joint, seed, within, size=1.0):
    """The rate at a random state against the slope along a motion; modes are of a size."""
    dae = mb.compile_dae(system)
    q, v = random_state(dae, np.random.default_rng(seed))
    q[7:10] *= size
    f = ca.Function("f", [system.q], [joint.displacement])
    exact = ca.Function("r", [system.q, system.v], [joint.displacement_rate])(q, v)
    assert_allclose(derivative(lambda h: np.asarray(f(coast(dae, q, v, h))).ravel()), float(exact), atol=within)


def test_flexible_bodies_have_handles_at_their_nodes():
    steel = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
    beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), steel, elements=4)
    rod = mb.FlexibleBody("rod", mb.FiniteElements.beams(beam).modes(count=3))
    slider = make_body("Spatial", "slider")
    joint = mb.Cylindrical("joint", rod.point(1.0, 0, 0), slider.point(0, 0.1, 0), axis=(1, 0, 0))
    assert_rate_of_displacement(mb.System(rod, slider, joint), joint, 3, 1e-7, size=0.01)


@pytest.mark.parametrize(
    ("joint", "handle", "text"),
    [
        (mb.Universal, "angle", "turns about two axes and does not slide. Use two Revolute joints"),
        (mb.Universal, "displacement", "turns about two axes and does not slide"),
        (mb.Spherical, "angle", "turns about three axes and does not slide. Use body.rotation, or three Revolute"),
        (mb.Spherical, "displacement_rate", "turns about three axes"),
        (mb.Revolute, "displacement", "does not slide. Use angle and angle_rate"),
        (mb.Prismatic, "angle_rate", "does not turn. Use displacement and displacement_rate"),
        (mb.Weld, "angle", "does not turn and does not slide"),
        (mb.PlanarJoint, "angle", "slides in two directions"),
        (mb.PointOnLine, "displacement", "Use coordinates and points of the joint's bodies"),
    ],
)
def test_joints_without_a_handle_say_why_not_and_what_to_use(joint, handle, text):
    a, b = make_body("Spatial", "a"), make_body("Spatial", "b")
    axes = {} if joint is mb.Spherical else {"axis": (1, 0, 0)}
    element = joint("j", a.point(0, 0), b.point(0, 0), **axes)
    refused(f"{joint.__name__} 'j' has no {handle}. .*{text}", getattr, element, handle)


def test_two_hinges_with_a_massless_body_between_them_are_the_universal_joint_with_angles():
    """Torques about both axes of the cross: the shaft with a Universal joint moves alike."""

    def run(joints):
        shaft = mb.Body("shaft", 1.0, (0.2, 0.3, 0.4), mb.Spatial())
        elements, outputs = joints(shaft.point(0, 0, 0.5)), {name: getattr(shaft, name) for name in "xyz"}
        outputs |= {"angle": elements[-1].angle} if len(elements) > 1 else {}
        loads = mb.Gravity(0, 0, -9.81), mb.Torque("turn", shaft, (0.3, 0.2, -0.4))
        return run_of(shaft, *elements, *loads, times=np.linspace(0, 0.5, 6), outputs=outputs)

    def cross(end):
        link = mb.Body("link", 0.0, (0.0, 0.0, 0.0), mb.Spatial())
        first = mb.Revolute("first", ORIGIN, link.point(0, 0), axis=(1, 0, 0))
        return link, first, mb.Revolute("second", link.point(0, 0), end, axis=(0, 1, 0))

    crossed = run(cross)
    plain = run(lambda end: [mb.Universal("joint", ORIGIN, end, axis=(1, 0, 0), axis_b=(0, 1, 0))])
    assert_allclose(crossed.values[:, :3], plain.values, atol=1e-8)
    assert np.ptp(crossed["angle"]) > 0.01


def test_handles_have_units():
    a, b = make_body("Spatial", "a"), make_body("Spatial", "b")
    c = mb.Cylindrical("c", a.point(0, 0.1, 0), b.point(0.1, 0, 0), axis=SKEW)
    outputs = [c.angle, c.angle_rate, c.displacement, c.displacement_rate, c.angle_rate * c.displacement]
    system = mb.System(a, b, c)
    assert units_of(system, ca.vertcat(*outputs)) == ("rad", "rad/s", "m", "m/s", "m/s")
    assert units_of(system, 3 * c.displacement) == ("",)


def test_own_states_have_the_units_of_their_laws():
    body = make_body("Planar", "a")
    hinge = mb.Revolute("hinge", GROUND.point(0, 0), body.point(0.1, 0))
    way = mb.State("way", rate=body.vx)
    held, unknown = mb.Sampled("held", 0.1, hinge.angle_rate), mb.State("unknown", rate=lambda z: -3 * z)
    system = mb.System(body, hinge, way, held, unknown)
    assert units_of(system, ca.vertcat(way.value, held.value, unknown.value)) == ("m", "rad/s", "")


# A planar scene and the same scene of spatial bodies move alike: one joint library for both.

TIMES = np.linspace(0, 2, 41)
TIGHT = mb.CVODES(rtol=1e-12, stabilization=mb.Projection())


def body(name, mass, inertia, planar):
    if planar:
        return mb.Body(name, mass, inertia, mb.Planar())
    return mb.Body(name, mass, (0.4 * inertia, 0.8 * inertia, inertia), mb.Spatial())


def run_alike(system, start, bodies, joint, **more):
    """Positions, velocities, turns and the reaction in a joint of the same names, whatever the poses are."""
    outputs, reaction = {}, system.reaction(joint)
    for b in bodies:
        point, R = b.point(0.3, 0.1), b.rotation
        outputs |= {f"{b.name}.p{name}": getattr(point, name) for name in ("x", "y", "vx", "vy")}
        outputs |= {f"{b.name}.turn": ca.atan2(R[1, 0], R[0, 0]), f"{b.name}.spin": b.omega[b.omega.numel() - 1]}
    outputs |= {name: getattr(reaction, name) for name in ("fx", "fy", "fz", "tx", "tz")}
    trajectory = mb.simulate(mb.Scene(system, start=start, times=TIMES, outputs=outputs, **more), TIGHT)
    assert trajectory.position_drift < 1e-13
    assert trajectory.energy_drift < 1e-9
    return trajectory.values


def chain(planar):
    """Two rods and a plate that slides along the second; spring, damper, torsion spring, force, torque, gravity."""
    rod1, rod2, plate = (body(f"b{i}", m, j, planar) for i, m, j in ((1, 1.0, 0.2), (2, 2.0, 0.1), (3, 0.5, 0.3)))
    system = mb.System(
        rod1, rod2, plate,
        mb.Revolute("shoulder", GROUND.point(0, 0), rod1.point(-0.5, 0)),
        mb.Revolute("elbow", rod1.point(0.5, 0.1), rod2.point(-0.4, 0)),
        mb.Prismatic("slide", rod2.point(0, 0), plate.point(0.1, 0), axis=(1, 0, 0)),
        mb.Gravity(0.3, -9.81),
        mb.SpringDamper("spring", rod2.point(0.2, 0), plate.point(0, 0.3), 80.0, 0.6, 0.2),
        mb.TorsionSpring("torsion", rod1, rod2, 3.0, 0.05, 0.4),
        mb.Force("push", plate.point(0, 0.2), (ca.sin(3 * mb.t), 1.0)),
        mb.Torque("twist", rod1, 0.4),
    )  # fmt: skip
    start = {"shoulder.angle": 0.3, "shoulder.angle_rate": 1.5, "elbow.angle": -1.1}
    return run_alike(system, start, (rod1, rod2, plate), "elbow")


def slider_crank(planar):
    """In space, a ball joint and a cylindrical joint carry the rod: with hinges it would be redundant."""
    parts = (("crank", 1.0, 0.1), ("rod", 1.5, 0.3), ("slider", 2.0, 0.2))
    crank, rod, slider = (body(*part, planar) for part in parts)
    wrist, pin = (mb.Revolute, mb.Revolute) if planar else (mb.Cylindrical, mb.Spherical)
    system = mb.System(
        crank, rod, slider,
        mb.Revolute("main", GROUND.point(0, 0), crank.point(-0.2, 0)),
        pin("pin", crank.point(0.2, 0), rod.point(-0.6, 0)),
        wrist("wrist", rod.point(0.6, 0), slider.point(0, 0)),
        mb.Prismatic("guide", GROUND.point(0, 0.1), slider.point(0, 0), axis=(1, 0, 0)),
        mb.Gravity(0, -9.81),
        mb.Spring("spring", GROUND.point(2.5, 0.1), slider.point(0, 0), 30.0, 0.5),
    )  # fmt: skip
    start, guess = {"main.angle": 0.6, "main.angle_rate": 4.0}, {"slider.x": 1.5, "rod.x": 0.9}
    return run_alike(system, start, (crank, rod, slider), "pin", guess=guess)


@pytest.mark.parametrize("machine", [chain, slider_crank], ids=lambda machine: machine.__name__)
def test_a_machine_moves_alike_in_the_plane_and_in_space(machine):
    planar, spatial = machine(True), machine(False)
    assert np.ptp(planar, axis=0)[0] > 0.3  # it moves
    assert_allclose(spatial, planar, atol=1e-8)
