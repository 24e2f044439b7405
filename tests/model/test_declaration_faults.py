"""What a wrong declaration is told: all faults at once, declared names, what was expected, the remedy."""

import math

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from faults import refused
from machines import GROUND, ORIGIN, ball
from processes import printed_lines

import symmb as mb

P = mb.Parameters(l1=1.0, m1=2.0, none=0.0)
FORGOTTEN = mb.Parameters(m=1.0, k=2.0, c=0.1, g=9.81, e=0.5)
ROD1, ROD2, STRANGER = (mb.Body(name, 1.0, 0.1, mb.Planar()) for name in ("rod1", "rod2", "stranger"))
TOP = mb.Body("top", 1.0, (0.1, 0.1, 0.2), mb.Spatial())
BALL, MASSLESS = mb.Body("ball", 1.0, pose=mb.Particle()), mb.Body("b", 0.0, 0.1)
CENTRE = ROD1.point(0, 0)
FAULTS = [
    (lambda: [P], r"neither a body, a constraint nor a force\. Pass parameters=p"),
    (lambda: [mb.Torque("rod1", ROD1, 1.0)], "Torque 'rod1': the name is used twice. Choose another name."),
    (lambda: [mb.Gravity(0, 1), mb.Gravity(1, 0)], "Gravity 'gravity': the name is used twice"),
    (lambda: [mb.Body("rod.1", 1.0, 0.1)], r"Body 'rod\.1': a name must not contain \. \[ \] or spaces"),
    (lambda: [mb.Body("", 1.0, 0.1)], "Body '': a name must have 1 to 100 printable characters"),
    (lambda: [mb.Spring("s", ORIGIN, CENTRE, 1.0)] * 2, "^Spring 's': the name is used twice"),
    (lambda: [mb.Damper(".", ORIGIN, CENTRE, 1.0)], "^Damper '.': a name must not contain"),
    (lambda: [mb.Revolute("r", ORIGIN, CENTRE, axis=(1,))], "^axis of Revolute 'r' has 1 component, expected two or"),
    (lambda: [mb.Revolute("r", ORIGIN, CENTRE, axis=(1, 0, 0, 0))], "^axis of Revolute 'r' has 4 components, expected"),
    (lambda: [mb.Gravity(0, 0, -9.81)], "Gravity 'gravity': force along z .* body 'rod1'"),
]


@pytest.mark.parametrize(("elements", "text"), FAULTS)
def test_a_fault_is_told_with_names_and_remedy(elements, text):
    refused(text, mb.System, ROD1, *elements(), parameters=P)


PLANAR, SPATIAL, PARTICLE = mb.Planar(), mb.Spatial(), mb.Particle()
OUTSIDE, BOTH = "does not belong to a parameter", "both points are on body 'rod1'"
ALIEN = rf"symbol 'stranger\.x' {OUTSIDE}"
SINE = r"\. Use casadi\.sin\(mb\.t\) instead .* Python's math gives NaN"
UNFIT, CAN_LEAVE = "cannot be used with", r"\. Particle 'ball' can leave the plane. Use Planar\(\)"
FRICTION, ABOUT_Z = r"Use Coulomb\(\.\.\.\) or Bristle\(\.\.\.\)", "planar bodies turn about z only"
PYTHON_IF = r"Python's if, and, or, max and min cannot decide .* Write casadi\.if_else"
NAN = "torque: .*(contains nan|contains NaN)"
STIFF = mb.KelvinVoigt(1e5)
OF_ELEMENTS = [
    (mb.Torque, (ROD1, STRANGER.x), f"torque: {ALIEN} or a body of the System"),
    (mb.Torque, (ROD1, mb.Parameters(m11=1.0).m11), rf"torque: symbol 'm11' {OUTSIDE} .* Did you mean 'm1'\?"),
    (mb.Prismatic, (ORIGIN, CENTRE, (1, mb.t, 0)), r"axis .* depends on t\. Use numbers and parameters only"),
    (mb.Torque, (ROD1, ROD1.theta * sp.Symbol("l1")), NAN),
    (mb.Torque, (ROD1, sp.Symbol("l1") * ROD1.theta), NAN),
    (mb.Force, (CENTRE, (np.nan, 0)), "force: contains NaN or infinity"),
    (mb.Force, (CENTRE, (math.sin(mb.t), 0)), f"force: contains NaN or infinity{SINE}"),
    (mb.Spring, (ORIGIN, CENTRE, np.inf), "stiffness is infinite. Give a finite number"),
    (mb.Damper, (ORIGIN, CENTRE, np.inf), "damping is infinite. Give a finite number"),
    (mb.Body, (math.inf, 1.0), "mass is infinite. Give a finite number"),
    (mb.Friction, (ORIGIN, CENTRE, (1, 0), -1.0, mb.Coulomb(0.2, 0.1)), "normal_force is -1; it must be"),
    (mb.Body, (-1.0, 1.0), "mass is negative at the nominal parameters"),
    (mb.Body, (P.l1 - P.m1, 1.0), "mass is negative at the nominal parameters"),
    (mb.Body, (1.0, (1, -1, 1), SPATIAL), "inertia is negative"),
    (mb.Body, (P.none, 1.0), "mass is an expression.* Declare the number 0 for a massless"),
    (mb.Body, ((1, 2), 1.0), "mass"),
    (mb.Body, ("heavy", 1.0), "mass: 'heavy' is not a number"),
    (mb.Body, (ROD1.omega, 1.0), r".*must not depend on velocities \(rod1\.omega\)"),
    (mb.Body, (1.0, (1, 2, 3), PLANAR), rf"inertia of shape \(3, 1\) {UNFIT} Planar\(\)\. Pass one scalar about z"),
    (mb.Body, (1.0, 1.0, SPATIAL), f".*{UNFIT} Spatial.*three principal values or a 3x3"),
    (mb.Body, (1.0, [[1, 0, 0], [0, 1]], SPATIAL), "inertia: the rows have 3 and 2"),
    (mb.Body, (1.0, [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], SPATIAL), "inertia matrix is not symmetric"),
    (mb.Body, (1.0, 1.0, PARTICLE), rf".*{UNFIT} Particle\(\)\. Pass no inertia"),
    (mb.Spring, (CENTRE, BALL.point(0, 0), 1.0), f"force along z .* planar body 'rod1'{CAN_LEAVE}", ROD1, BALL),
    (mb.Force, (CENTRE, 3.0), r"expected a force \(fx, fy"),
    (mb.Spring, (CENTRE, ROD1.point(1, 0), 1.0), BOTH),
    (mb.TorsionSpring, (GROUND, TOP, 1.0, 0.0, 0.0, (0, 0, 0)), "axis .* has no direction", TOP),
    (mb.TorsionSpring, (GROUND, ROD1, 1.0, 0.0, 0.0, (1, 0, 0)), ABOUT_Z),
    (mb.TorsionSpring, (GROUND, CENTRE, 1.0), "expected a body, got Point"),
    (mb.Motion, (1.0, mb.t), "no coordinate can satisfy row"),
    (mb.Motion, (ROD1.x, ROD1.x), "all rows of this constraint are identically zero"),
    (mb.Contact, (CENTRE, ORIGIN, (0, 1), STIFF, 0.1, 0.3), rf"expected a friction law, got 0\.3\. {FRICTION}"),
    (mb.Contact, (CENTRE, ORIGIN, (0, 1), mb.KelvinVoigt(STRANGER.x)), f"stiffness: {ALIEN} or a body"),
    (mb.TorsionContact, (GROUND, ROD1, 0.1, STIFF, 0.0, (1, 0, 0)), rf"{ABOUT_Z}, but the axis is \(1, 0, 0\)"),
    (mb.NonlinearSpring, (ORIGIN, CENTRE, lambda d, v: d if d > 1 else 0), PYTHON_IF),
    (mb.NonlinearSpring, (ORIGIN, CENTRE, lambda d, v: STRANGER.x * d), f"pull: {ALIEN}"),
    (mb.Soil, (CENTRE, ROD1.point(1, 0), (0, 1), STIFF), f"{BOTH}, so the element has no effect"),
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


def rod_beside_wrong_bodies():
    rope = mb.Distance("rope", ORIGIN, CENTRE, -1.0)
    elbow = mb.Revolute("elbow", CENTRE, ROD2.point(0, 0), axis=(1, 0, 0))
    told = ("'rod1': the name", "'b': mass is negative", "body 'rod2' is not part", "'rope': length")
    return [ROD1, ROD1, mb.Body("b", -1.0, 1.0), elbow, rope], (*told, "planar body 'rod1'"), 6


def laws():
    drives = mb.Force("push", CENTRE, (STRANGER.x, 0, 1)), mb.Torque("twist", ROD1, ca.SX.sym("c"))
    told = "Force 'push'", "Torque 'twist'", "Motion 'drive'", "Gravity 'gravity'"
    return [ROD1, *drives, mb.Motion("drive", STRANGER.x, mb.t), mb.Gravity(0, 0, -9.81)], told, 4


def all_kinds_and_forgotten_parameters():
    p = FORGOTTEN
    ball, cube = mb.Body("ball", p.m, pose=mb.Particle()), mb.Body("cube", -1.0, 1.0)
    hinge = mb.Revolute("hinge", ORIGIN, cube.point(0, 0), axis=(0, 0, 0))
    spring, floor = mb.Spring("spring", ORIGIN, ball.point(0, 0), p.k * p.c), mb.Impact("floor", ball.y, p.e)
    forgotten = [f"symbol '{name}' belongs to Parameters that the System does not have" for name in "mkcge"]
    told = (*forgotten, "mass is negative", "has no direction", "contains NaN")
    return [ball, cube, spring, mb.Gravity(0, -p.g), floor, hinge, mb.Motion("drive", cube.x, np.nan)], told, 8


@pytest.mark.parametrize("make", [rod_beside_wrong_bodies, laws, all_kinds_and_forgotten_parameters])
def test_all_faults_of_a_system_are_told_at_once(make):
    elements, told, count = make()
    lines = refused(None, mb.System, *elements, parameters=mb.Parameters()).split("\n")
    assert len(lines) == count
    for name in told:
        assert sum(name in line for line in lines) == 1, name


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
        (
            lambda: mb.DAESimulator(mb.Scene(mb.System(MASSLESS))),
            r"Nothing determines the acceleration of b\.vx, b\.vy",
        ),
    ],
)
def test_faults_outside_of_a_system(declare, text):
    with pytest.raises(mb.DeclarationError, match=text):
        mb.System(ROD1, mb.Revolute("hinge", ORIGIN, declare()))  # a point is judged by who uses it


def test_an_unknown_parameter_is_an_attribute_error_that_lists_the_known():
    refused(r"no parameter 'l2'\. Declared parameters: l1, m1, none", getattr, P, "l2", error=AttributeError)


@pytest.mark.parametrize(
    ("inertia", "is_possible"),
    [
        ((1, 1, 3), False), ((1, 1, 2), True), ((0.123, 0.123, 0.2463), True),  # a plate, rounded
        ([[1, 0, 0], [0, 1, 0.9], [0, 0.9, 1]], False), ([[2, 0, 0], [0, 1, 0.9], [0, 0.9, 1]], True),
        ([[1, 0, 0], [0, 1, 2], [0, 2, 1]], False), ((1, -1, 1), False),
    ],
)  # fmt: skip
def test_inertias_that_no_body_has(inertia, is_possible):
    def prepare():
        body = mb.Body("body", 1.0, inertia, mb.Spatial())
        mb.DAESimulator(mb.Scene(mb.System(body), start={"body.omega_x": 1.0}, times=[0.0, 0.1]))

    prepare() if is_possible else refused("inertia", prepare, error=mb.SymmbError)


def test_a_box_in_which_a_moment_of_inertia_exceeds_the_others():
    p = mb.Parameters(a=1.0, c=1.5)
    body = mb.Body("body", 1.0, (p.a, p.a, p.c), mb.Spatial())
    box, told = mb.Box(a=(0.5, 1.5), c=(1.4, 1.6)), r"triangle inequality of moments of inertia .* is .* at a = 0\.5"
    refused(told, mb.Scene, mb.System(body, parameters=p), times=[0.0, 1.0], box=box)


def test_python_cannot_decide_on_expressions():
    with pytest.raises(mb.DeclarationError, match=r"whether \(1<t\) is true, .* Write casadi\.if_else"):
        _ = 1.0 if mb.t > 1 else 0.0
    assert not ca.SX(0) and bool(mb.t == mb.t)


def test_numpy_takes_expressions_without_warnings(recwarn):
    push = lambda m: mb.Force("push", m.at, (np.sin(mb.t) + np.exp(-mb.t), 0))  # noqa: E731
    run = ball(push, g=None).run("vx", [0.0, 1.5])
    assert abs(run["vx"][-1] - (1 - np.cos(1.5) + 1 - np.exp(-1.5))) < 1e-8
    assert not recwarn.list


# Names that would break C, LaTeX, tables, pictures or files: refused, or harmless.

COMMAND = 'x */ system("touch pwned"); /*'
BAD = [COMMAND, "a\nb", "tab\there", "\x1b[31mred", "", " padded ", "right\u202eleft", "n" * 101, "nul\0"]
BAD += [3, None, ("x",)]
ODD = ["naïve θ", *'a*/b 50% $x_{ back\\slash quo"te <b>&amp; .. ../up #1~^{} -rf {0} %s%n ??/'.split()]


def scene(body="rod", parameter="l", output="x", joint="hinge"):
    p = mb.Parameters(**{parameter: 1.0})
    rod = mb.Body(body, 1.0, 0.1, mb.Planar())
    hinge = mb.Revolute(joint, ORIGIN, rod.point(-p.symbols[0] / 2, 0))
    system = mb.System(rod, hinge, mb.Gravity(0, -9.81), parameters=p)
    return mb.Scene(system, {}, np.linspace(0, 0.1, 3), {output: rod.x}, box=mb.Box(**{parameter: (0.9, 1.1)}))


@pytest.mark.parametrize("kind", ["body", "parameter", "output", "joint"])
@pytest.mark.parametrize("name", BAD, ids=repr)
def test_bad_names_are_refused(kind, name):
    if kind == "parameter" and not isinstance(name, str):
        pytest.skip("keywords are texts")
    if kind == "output" and name == COMMAND:
        pytest.skip("harmless: test_odd_names_do_no_harm")
    text = refused("(a|the) name must", scene, **{kind: name})
    assert text.isprintable() or "\n" in text


@pytest.mark.parametrize("name", ODD, ids=repr)
def test_odd_parameters_are_refused(name):
    refused("the name must consist of letters, digits and underscores", scene, parameter=name)


@pytest.mark.parametrize("name", [*ODD, COMMAND.replace(" ", "")], ids=repr)
def test_odd_names_do_no_harm(tmp_path, name):
    body = name if not any(c in name for c in ".[] ") else "rod"
    made = scene(body=body, joint=f"{body}'", output=name)
    simulator = mb.DAESimulator(made)
    simulator.dae.save_c(tmp_path / "c", {**simulator.start.nominal(), "times": simulator.times})
    head, *rows = printed_lines(tmp_path / "c")
    assert head.split()[:2] == ["t", f"{body}.x"] and len(rows) == 101
    assert not list(tmp_path.glob("**/pwned"))
    latex = made.system.latex()
    for escaped in (r"\{", r"\}", r"\%", r"\#"):
        latex = latex.replace(escaped, "")
    assert latex.count("{") == latex.count("}") and "%" not in latex and "#" not in latex
    run = mb.simulate(made)
    run.plot(tmp_path / "run.png")
    for suffix in ("csv", "npz", "json"):
        run.save(tmp_path / f"run.{suffix}")
        np.testing.assert_array_equal(mb.Trajectory.load(tmp_path / f"run.{suffix}")[name], run[name])
    comparison = mb.compare(made, mb.Vertex())
    comparison.plot(tmp_path / "c.png")
    assert name in str(comparison)
