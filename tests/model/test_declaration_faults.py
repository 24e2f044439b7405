"""What a wrong declaration is told: all faults at once, declared names, what was expected, the remedy."""

import math

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from faults import refused

import symmb as mb

GROUND = mb.Ground()
P = mb.Parameters(l1=1.0, m1=2.0, none=0.0)
ROD1, ROD2, STRANGER = (mb.Body(name, 1.0, 0.1, mb.Planar()) for name in ("rod1", "rod2", "stranger"))
TOP = mb.Body("top", 1.0, (0.1, 0.1, 0.2), mb.Spatial())
BALL = mb.Body("ball", 1.0, pose=mb.Particle())
ORIGIN, CENTRE = GROUND.point(0, 0), ROD1.point(0, 0)


def spatial(**more):
    return mb.Body("plate", 1.0, pose=mb.Spatial(), **more)


NAN = "Torque 'drive': torque: .*(contains nan|contains NaN)"
FAULTS = [
    (lambda: [P], r"neither a body, a constraint nor a force\. Pass parameters=p"),
    (lambda: [mb.Torque("rod1", ROD1, 1.0)], "Torque 'rod1': the name is used twice. Choose another name."),
    (lambda: [mb.Gravity(0, 1), mb.Gravity(1, 0)], "Gravity 'gravity': the name is used twice"),
    (lambda: [mb.Body("rod.1", 1.0, 0.1)], r"Body 'rod\.1': a name must not contain \. \[ \] or spaces"),
    (lambda: [mb.Body("", 1.0, 0.1)], "Body '': a name must have 1 to 100 printable characters"),
    (
        lambda: [mb.Torque("drive", ROD1, STRANGER.theta)],
        r"Torque 'drive': torque: symbol 'stranger\.theta' does not belong to a parameter or a body of the System",
    ),
    (
        lambda: [mb.Torque("drive", ROD1, mb.Parameters(m11=1.0).m11)],
        r"symbol 'm11' does not belong to a parameter .* Did you mean 'm1'\?",
    ),
    (
        lambda: [mb.Prismatic("slide", ORIGIN, CENTRE, axis=(1, mb.t, 0)), ROD1],
        r"Prismatic 'slide': axis .* depends on t\. Use numbers and parameters only",
    ),
    (lambda: [mb.Torque("drive", ROD1, ROD1.theta * sp.Symbol("l1"))], NAN),
    (lambda: [mb.Torque("drive", ROD1, sp.Symbol("l1") * ROD1.theta)], NAN),
    (lambda: [mb.Force("push", CENTRE, (np.nan, 0))], "Force 'push': force: contains NaN or infinity"),
    (
        lambda: [mb.Force("push", CENTRE, (math.sin(mb.t), 0))],
        r"Force 'push': force: contains NaN or infinity\. Use casadi\.sin\(mb\.t\) instead .* Python's math gives NaN",
    ),
    (lambda: [mb.Spring("s", ORIGIN, CENTRE, np.inf)], "^Spring 's': stiffness is infinite. Give a finite number"),
    (lambda: [mb.Damper("d", ORIGIN, CENTRE, np.inf)], "^Damper 'd': damping is infinite. Give a finite number"),
    (lambda: [mb.Body("b", math.inf, 1.0)], "^Body 'b': mass is infinite. Give a finite number"),
    (lambda: [mb.Spring("s", ORIGIN, CENTRE, 1.0)] * 2, "^Spring 's': the name is used twice"),
    (lambda: [mb.Damper(".", ORIGIN, CENTRE, 1.0)], "^Damper '.': a name must not contain"),
    (lambda: [mb.Revolute("r", ORIGIN, CENTRE, axis=(1,))], "^axis of Revolute 'r' has 1 component, expected two or"),
    (lambda: [mb.Revolute("r", ORIGIN, CENTRE, axis=(1, 0, 0, 0))], "^axis of Revolute 'r' has 4 components, expected"),
    (lambda: [mb.Friction("f", ORIGIN, CENTRE, (1, 0), -1.0, mb.Coulomb(0.2, 0.1))], "normal_force is -1; it must be"),
    (lambda: [mb.Body("b", -1.0, 1.0)], "Body 'b': mass is negative at the nominal parameters"),
    (lambda: [mb.Body("b", P.l1 - P.m1, 1.0)], "Body 'b': mass is negative at the nominal parameters"),
    (lambda: [spatial(inertia=(1, -1, 1))], "Body 'plate': inertia is negative"),
    (lambda: [mb.Body("b", P.none, 1.0)], "Body 'b': mass is an expression.* Declare the number 0 for a massless"),
    (lambda: [mb.Body("b", (1, 2), 1.0)], "Body 'b': mass has 2 components|'b': mass"),
    (lambda: [mb.Body("b", "heavy", 1.0)], "Body 'b': mass: 'heavy' is not a number"),
    (lambda: [mb.Body("b", ROD1.omega, 1.0), ROD1], r"must not depend on velocities \(rod1\.omega\)"),
    (
        lambda: [mb.Body("b", 1.0, (1, 2, 3), mb.Planar())],
        r"Body 'b': inertia of shape \(3, 1\) cannot be used with Planar\(\)\. Pass one scalar about z",
    ),
    (lambda: [spatial(inertia=1.0)], "cannot be used with Spatial.*three principal values or a 3x3"),
    (lambda: [spatial(inertia=[[1, 0, 0], [0, 1]])], "Body 'plate': inertia: the rows have 3 and 2"),
    (lambda: [spatial(inertia=[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]])], "Body 'plate': inertia matrix is not symmetric"),
    (lambda: [mb.Body("b", 1.0, 1.0, mb.Particle())], r"cannot be used with Particle\(\)\. Pass no inertia"),
    (
        lambda: [ROD1, BALL, mb.Spring("rubber", CENTRE, BALL.point(0, 0), 1.0)],
        r"Spring 'rubber': force along z .* planar body 'rod1'\. Particle 'ball' can leave the plane. Use Planar\(\)",
    ),
    (lambda: [mb.Gravity(0, 0, -9.81)], "Gravity 'gravity': force along z .* body 'rod1'"),
    (lambda: [mb.Force("push", CENTRE, 3.0)], r"Force 'push': expected a force \(fx, fy"),
    (lambda: [mb.Spring("s", CENTRE, ROD1.point(1, 0), 1.0)], "^Spring 's': both points are on body 'rod1'"),
    (
        lambda: [TOP, mb.TorsionSpring("s", GROUND, TOP, 1.0, axis=(0, 0, 0))],
        "TorsionSpring 's': axis .* has no direction",
    ),
    (
        lambda: [mb.TorsionSpring("s", GROUND, ROD1, 1.0, axis=(1, 0, 0))],
        "TorsionSpring 's': planar bodies turn about z only",
    ),
    (lambda: [mb.TorsionSpring("s", GROUND, CENTRE, 1.0)], "TorsionSpring 's': expected a body, got Point"),
    (lambda: [mb.Motion("drive", 1.0, mb.t)], "Motion 'drive': no coordinate can satisfy row"),
    (lambda: [mb.Motion("drive", ROD1.x, ROD1.x)], "Motion 'drive': all rows of this constraint are identically zero"),
    (
        lambda: [mb.Contact("c", CENTRE, ORIGIN, (0, 1), mb.KelvinVoigt(1e5), 0.1, 0.3)],
        r"Contact 'c': expected a friction law, got 0\.3\. Use Coulomb\(\.\.\.\) or Bristle\(\.\.\.\)",
    ),
    (
        lambda: [mb.Contact("c", CENTRE, ORIGIN, (0, 1), mb.KelvinVoigt(STRANGER.x))],
        r"Contact 'c': stiffness: symbol 'stranger\.x' does not belong to a parameter or a body",
    ),
    (
        lambda: [mb.TorsionContact("k", GROUND, ROD1, 0.1, mb.KelvinVoigt(1e5), axis=(1, 0, 0))],
        r"TorsionContact 'k': planar bodies turn about z only, but the axis is \(1, 0, 0\)",
    ),
    (
        lambda: [mb.NonlinearSpring("n", ORIGIN, CENTRE, lambda d, v: d if d > 1 else 0)],
        r"NonlinearSpring 'n': Python's if, and, or, max and min cannot decide .* Write casadi\.if_else",
    ),
    (
        lambda: [mb.NonlinearSpring("n", ORIGIN, CENTRE, lambda d, v: STRANGER.x * d)],
        r"NonlinearSpring 'n': pull: symbol 'stranger\.x' does not belong to a parameter",
    ),
    (
        lambda: [mb.Soil("s", CENTRE, ROD1.point(1, 0), (0, 1), mb.KelvinVoigt(1e5))],
        "Soil 's': both points are on body 'rod1', so the element has no effect",
    ),
]


@pytest.mark.parametrize(("elements", "text"), FAULTS)
def test_a_fault_is_told_with_names_and_remedy(elements, text):
    needed = [] if any(e in (ROD1, TOP, BALL) for e in elements() if isinstance(e, mb.Body)) else [ROD1]
    refused(text, mb.System, *needed, *elements(), parameters=P)


STIFF = mb.KelvinVoigt(1e5)
OF_ELEMENTS = [
    (mb.Revolute, (CENTRE, ROD2.point(0, 0)), r"body 'rod2' is not part of the System\. Add it"),
    (mb.Torque, (ROD1, sp.Symbol("rod1.teta")), r"torque: Unknown symbol 'rod1\.teta' .*Did you mean 'rod1\.theta'\?"),
    (mb.SpringDamper, (ORIGIN, CENTRE, 1.0, np.inf), "damping is infinite. Give a finite number"),
    (mb.Revolute, (ORIGIN, ROD1.point(np.nan, 0)), "a point of body 'rod1' contains NaN or infinity"),
    (mb.Force, (CENTRE, (0, 0, 2)), r"force along z \(2\.?\) acts out of the plane of planar body 'rod1'\. Leave it"),
    (mb.Torque, (ROD1, (1, 0, 0)), r"torque about x \(.*\) acts out of the plane of planar body 'rod1'"),
    (mb.Torque, (BALL, 1.0), r"body 'ball' has Particle\(\), which cannot be used", BALL),
    (mb.Bushing, (ORIGIN, TOP.point(0, 0), (1, 2)), "stiffness has 2 components. Pass one number or three", TOP),
    (mb.Bushing, (ORIGIN, TOP.point(0, 0), np.zeros(3, [("a", float)])), "stiffness: array.* is not a number", TOP),
    (mb.Motion, (ROD1.vx, mb.t), "a position row must not contain velocities. Use VelocityConstraint"),
    (mb.VelocityConstraint, ((ROD1.x,),), "each expression must contain velocities and be linear"),
    (mb.VelocityConstraint, ((ROD1.vx**2,),), "each expression must contain velocities and be linear"),
    (mb.Contact, (CENTRE, ORIGIN, (0, 1), 1e5), r"expected a contact law, got 100000\.0\. Use HuntCrossley\(\.\.\.\)"),
    (mb.Contact, (CENTRE, ORIGIN, (0, 0), STIFF), r"normal \(0, 0\) has no direction\. Pass a vector that is not zero"),
    (mb.TorsionContact, (GROUND, BALL, 0.1, STIFF), r"body 'ball' has Particle\(\), which cannot be used", BALL),
    (mb.Friction, (ORIGIN, CENTRE, (0, 0), 1.0, mb.Coulomb(0.3, 1e-3)), r"axis \(0, 0\) has no direction"),
    (mb.NonlinearSpring, (ORIGIN, CENTRE, 30.0), r"pull 30\.0 is not a function\. Pass a function of length and rate"),
    (mb.VelocityConstraint, (ROD1.vx,), "expressions must be a tuple or a list, got SX"),
]
"""A class and its arguments after the name, what is told of them, and the bodies of the system if not `rod1`."""


@pytest.mark.parametrize("case", OF_ELEMENTS, ids=lambda case: f"{case[0].__name__}: {case[2]}")
def test_a_fault_of_an_element_is_told_with_its_name_and_the_remedy(case):
    kind, arguments, text, *bodies = case
    with pytest.raises(mb.DeclarationError, match=f"(?m)^{kind.__name__} 'part': {text}"):
        mb.System(*(bodies or [ROD1]), kind("part", *arguments), parameters=P)


def test_all_faults_of_a_system_are_told_at_once():
    with pytest.raises(mb.DeclarationError) as told:
        mb.System(
            ROD1, ROD1, mb.Body("b", -1.0, 1.0),
            mb.Revolute("elbow", CENTRE, ROD2.point(0, 0), axis=(1, 0, 0)),
            mb.Distance("rope", ORIGIN, CENTRE, -1.0),
        )  # fmt: skip
    faults = str(told.value).split("\n")
    assert len(faults) == 6
    names = (
        "'rod1': the name", "'b': mass is negative", "body 'rod2' is not part", "planar body 'rod1'",
        "'rope': length",
    )  # fmt: skip
    for name in names:
        assert any(name in fault for fault in faults), name


def test_all_faults_of_the_laws_are_told_at_once():
    with pytest.raises(mb.DeclarationError) as told:
        mb.System(
            ROD1,
            mb.Force("push", CENTRE, (STRANGER.x, 0, 1)),
            mb.Torque("twist", ROD1, ca.SX.sym("c")),
            mb.Motion("drive", STRANGER.x, mb.t),
            mb.Gravity(0, 0, -9.81),
        )
    text = str(told.value)
    for name in ("Force 'push'", "Torque 'twist'", "Motion 'drive'", "Gravity 'gravity'"):
        assert text.count(name) == 1, name


@pytest.mark.parametrize(
    ("declare", "text"),
    [
        (lambda: mb.Parameters(l=np.nan), "parameter 'l': nominal value nan is not a finite number"),
        (lambda: mb.Parameters(l="1"), "parameter 'l': nominal value '1'"),
        (lambda: mb.Parameters(nominal=1.0, keys=2.0), "parameter 'nominal': symmb uses this name itself.*\n.*'keys'"),
        (lambda: mb.Body("b", 1.0, pose="Planar"), r"Body 'b': 'Planar' is not a pose\. Use Planar\(\)"),
        (lambda: mb.Body("b", 1.0, pose=mb.Planar), r"Body 'b': .*Planar.* is not a pose"),
        (lambda: ROD1.point(1, 2, 3), r"Revolute 'hinge': the point on planar body 'rod1' has z = 3"),
        (lambda: ROD1.point("tip", 0), "point of 'rod1': .*neither a number nor CasADi SX"),
        (lambda: mb.Body("b", 1.0, com=(0, 0, 0, 0)).point(0, 0), "com of 'b' has 4 components, expected two or three"),
        (lambda: TOP.theta, r"Body 'top' has pose=Spatial\(\) and no angle theta\. Use joint\.angle"),
        *(
            (lambda turn=turn: mb.rotation(*turn), "rotation: angle .* must be finite, and the axis must not be zero")
            for turn in [
                *(((1, 0, 0), angle) for angle in (np.nan, np.array([np.inf]))),
                *((axis, 0.3) for axis in ((0, np.nan, 0), (0, P.l1 * np.nan, 0), (0, 0, 0))),
            ]
        ),
        (lambda: mb.ddt(ROD1.vx), r"ddt: expected an expression of positions, but 'rod1\.vx' is a velocity"),
        (lambda: mb.ddt(np.array([1.0, np.nan])), "ddt: expected a finite number or CasADi SX"),
        (lambda: mb.ddt(float("inf")), "ddt: expected a finite number or CasADi SX"),
    ],
)
def test_faults_outside_of_a_system(declare, text):
    with pytest.raises(mb.DeclarationError, match=text):
        mb.System(ROD1, mb.Revolute("hinge", ORIGIN, declare()))  # a point is judged by who uses it


def test_an_unknown_parameter_is_an_attribute_error_that_lists_the_known():
    with pytest.raises(AttributeError, match=r"no parameter 'l2'\. Declared parameters: l1, m1, none"):
        _ = P.l2


@pytest.mark.parametrize(
    ("inertia", "is_possible"),
    [
        ((1, 1, 3), False),
        ((1, 1, 2), True),
        ((0.123, 0.123, 0.2463), True),  # a plate, rounded
        ([[1, 0, 0], [0, 1, 0.9], [0, 0.9, 1]], False),
        ([[2, 0, 0], [0, 1, 0.9], [0, 0.9, 1]], True),
        ([[1, 0, 0], [0, 1, 2], [0, 2, 1]], False),
        ((1, -1, 1), False),
    ],
)
def test_inertias_that_no_body_has(inertia, is_possible):
    def prepare():
        body = mb.Body("body", 1.0, inertia, mb.Spatial())
        mb.DAESimulator(mb.Scene(mb.System(body), start={"body.omega_x": 1.0}, times=[0.0, 0.1]))

    if is_possible:
        prepare()
        return
    refused("inertia", prepare, error=mb.SymmbError)


def test_a_box_in_which_a_moment_of_inertia_exceeds_the_others():
    p = mb.Parameters(a=1.0, c=1.5)
    body = mb.Body("body", 1.0, (p.a, p.a, p.c), mb.Spatial())
    with pytest.raises(mb.DeclarationError, match=r"triangle inequality of moments of inertia .* is .* at a = 0\.5"):
        mb.Scene(mb.System(body, parameters=p), times=[0.0, 1.0], box=mb.Box(a=(0.5, 1.5), c=(1.4, 1.6)))


def test_bodies_without_inertia_that_nothing_carries_are_named():
    rod = mb.Body("rod", 0.0, 0.1)
    scene = mb.Scene(mb.System(rod), times=[0.0, 1.0])
    refused(r"Nothing determines the acceleration of rod\.vx, rod\.vy", mb.DAESimulator, scene)


def test_python_cannot_decide_on_expressions():
    with pytest.raises(mb.DeclarationError, match=r"whether \(1<t\) is true, .* Write casadi\.if_else"):
        _ = 1.0 if mb.t > 1 else 0.0
    assert not ca.SX(0) and bool(mb.t == mb.t)


def test_numpy_takes_expressions_without_warnings(recwarn):
    mass = mb.Body("mass", 1.0, pose=mb.Particle())
    force = mb.Force("push", mass.point(0, 0), (np.sin(mb.t) + np.exp(-mb.t), 0))
    run = mb.simulate(mb.Scene(mb.System(mass, force), times=[0.0, 1.5], outputs={"v": mass.vx}))
    assert abs(run["v"][-1] - (1 - np.cos(1.5) + 1 - np.exp(-1.5))) < 1e-8
    assert not recwarn.list


def test_faults_of_laws_masses_names_and_forgotten_parameters_come_together():
    p = mb.Parameters(m=1.0, k=2.0, c=0.1, g=9.81, e=0.5)
    ball, cube = mb.Body("ball", p.m, pose=mb.Particle()), mb.Body("cube", -1.0, 1.0)
    elements = (
        ball, cube,
        mb.Spring("spring", ORIGIN, ball.point(0, 0), p.k * p.c),
        mb.Gravity(0, -p.g),
        mb.Impact("floor", ball.y, p.e),
        mb.Revolute("hinge", ORIGIN, cube.point(0, 0), axis=(0, 0, 0)),
        mb.Motion("drive", cube.x, np.nan),
    )  # fmt: skip
    error = refused(None, mb.System, *elements, parameters=mb.Parameters())
    lines = error.split("\n")
    for name in "mkcge":
        text = f"symbol '{name}' belongs to Parameters that the System does not have"
        assert sum(text in line for line in lines) == 1
    for text in ("mass is negative", "has no direction", "contains NaN"):
        assert sum(text in line for line in lines) == 1
    assert len(lines) == 8
