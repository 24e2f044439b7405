"""Angles and displacements of joints against SciPy's rotations, their rates against differences along a motion."""

import casadi as ca
import numpy as np
import pytest
from joints import KINDS, OTHER, SKEW, coast, derivative, make_body, random_state
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import symmb as mb
from symmb.equations.model import units_of

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


def declared(joint, a, b, more):
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
    angle, displacement = at
    element = declared(joint, a, b, more)
    planar = "Planar" in (a, b)
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
    element = declared(joint, a, b, more)
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
    element = declared(joint, "Spatial", "Spatial", {"pitch": 0.5} if joint is mb.Screw else {})
    system = mb.System(*element.bodies(), element)
    dae = mb.compile_dae(system)
    q, v = random_state(dae, np.random.default_rng(2))
    f = ca.Function("f", [system.q], [element.displacement])
    exact = ca.Function("r", [system.q, system.v], [element.displacement_rate])(q, v)
    assert_allclose(derivative(lambda h: np.asarray(f(coast(dae, q, v, h))).ravel()), float(exact), atol=1e-9)


def test_flexible_bodies_have_handles_at_their_nodes():
    steel = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
    beam = mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.02), steel, elements=4)
    rod = mb.FlexibleBody("rod", mb.FiniteElements.beams(beam).modes(count=3))
    slider = make_body("Spatial", "slider")
    joint = mb.Cylindrical("joint", rod.point(1.0, 0, 0), slider.point(0, 0.1, 0), axis=(1, 0, 0))
    system = mb.System(rod, slider, joint)
    dae = mb.compile_dae(system)
    q, v = random_state(dae, np.random.default_rng(3))
    q[7:10] *= 0.01
    f = ca.Function("f", [system.q], [joint.displacement])
    exact = ca.Function("r", [system.q, system.v], [joint.displacement_rate])(q, v)
    assert_allclose(derivative(lambda h: np.asarray(f(coast(dae, q, v, h))).ravel()), float(exact), atol=1e-7)


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
    with pytest.raises(mb.DeclarationError, match=f"{joint.__name__} 'j' has no {handle}. .*{text}"):
        getattr(element, handle)


def test_two_hinges_with_a_massless_body_between_them_are_the_universal_joint_with_angles():
    """Torques about both axes of the cross: the shaft with a Universal joint moves alike."""
    ground = mb.Ground()
    force = {"torque": (0.3, 0.2, -0.4)}

    def run(cross):
        shaft = mb.Body("shaft", 1.0, (0.2, 0.3, 0.4), mb.Spatial())
        end = shaft.point(0, 0, 0.5)
        outputs = {name: getattr(shaft, name) for name in "xyz"}
        if cross:
            link = mb.Body("link", 0.0, (0.0, 0.0, 0.0), mb.Spatial())
            first = mb.Revolute("first", ground.point(0, 0), link.point(0, 0), axis=(1, 0, 0))
            second = mb.Revolute("second", link.point(0, 0), end, axis=(0, 1, 0))
            joints = [link, first, second]
            outputs |= {"angle": second.angle}
        else:
            joints = [mb.Universal("joint", ground.point(0, 0), end, axis=(1, 0, 0), axis_b=(0, 1, 0))]
        system = mb.System(shaft, *joints, mb.Gravity(0, 0, -9.81), mb.Torque("turn", shaft, **force))
        return mb.simulate(mb.Scene(system, times=np.linspace(0, 0.5, 6), outputs=outputs))

    with_angles, plain = run(True), run(False)
    for name in "xyz":
        assert_allclose(with_angles[name], plain[name], atol=1e-8)
    assert np.ptp(with_angles["angle"]) > 0.01


def test_handles_have_units():
    a, b = make_body("Spatial", "a"), make_body("Spatial", "b")
    c = mb.Cylindrical("c", a.point(0, 0.1, 0), b.point(0.1, 0, 0), axis=SKEW)
    outputs = [c.angle, c.angle_rate, c.displacement, c.displacement_rate, c.angle_rate * c.displacement]
    system = mb.System(a, b, c)
    assert units_of(system, ca.vertcat(*outputs)) == ("rad", "rad/s", "m", "m/s", "m/s")
    assert units_of(system, 3 * c.displacement) == ("",)


def test_own_states_have_the_units_of_their_laws():
    body = make_body("Planar", "a")
    hinge = mb.Revolute("hinge", mb.Ground().point(0, 0), body.point(0.1, 0))
    way = mb.State("way", rate=body.vx)
    held, unknown = mb.Sampled("held", 0.1, hinge.angle_rate), mb.State("unknown", rate=lambda z: -3 * z)
    system = mb.System(body, hinge, way, held, unknown)
    assert units_of(system, ca.vertcat(way.value, held.value, unknown.value)) == ("m", "rad/s", "")
