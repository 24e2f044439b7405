"""What may be left out, and what may be written as a text."""

import copy
import pickle

import casadi as ca
import numpy as np
import pytest
from faults import refused

import symmb as mb

T = np.linspace(0.0, 1.0, 4)
DECAY = mb.FunctionSimulator(lambda k, a: np.stack([a * np.exp(-k * T), k * T], 1), {"k": 1.3, "a": 2.0}, T, ["x", "y"])
BOX = mb.Box(k=(0.7, 1.9))
P = mb.Parameters(stiffness=5.3, unused=1.0, mass=0.7)


def oscillator():
    mass = mb.Body("mass", P.mass, pose=mb.Particle())
    return mass, mb.Spring("spring", mb.Ground().point(0, 0), mass.point(0, 0), P.stiffness)


def scene(**more):
    elements = oscillator()
    outputs = {"x": elements[0].x} | more.pop("outputs", {})
    return mb.Scene(mb.System(*elements), {"mass.x": 0.4}, np.linspace(0.0, 2.0, 5), outputs, **more)


def same(a, b):
    return np.array_equal(a.lower, b.lower) and np.array_equal(a.upper, b.upper) and a.method == b.method


def test_a_study_without_a_method_is_by_polynomial_chaos():
    assert same(mb.propagate(DECAY, box=BOX), mb.propagate(DECAY, mb.PolynomialChaos(), BOX))


@pytest.mark.parametrize(
    ("text", "method"),
    [
        ("pce:3", mb.PolynomialChaos(order=3)), ("vertex", mb.Vertex()), ("mc:13", mb.MonteCarlo(13)),
        ("scan:7", mb.Scanning(7)), ("pce:2:paper", mb.PolynomialChaos.paper(order=2)),
    ],
)  # fmt: skip
def test_methods_by_their_texts(text, method):
    assert same(mb.propagate(DECAY, text, BOX), mb.propagate(DECAY, method, BOX))
    comparison = mb.compare(DECAY, [text, "vertex"], BOX, reference="scan:9")
    assert [row.name for row in comparison.rows] == [repr(method), "Vertex()"]
    assert comparison.reference.method == "Scanning(9)"


def test_texts_that_are_no_method_or_solver_are_told():
    refused("There is no method 'taylr'. Did you mean 'taylor'", mb.propagate, DECAY, "taylr", BOX)
    refused("There is no solver 'dopry'. Did you mean 'dopri'", mb.simulate, scene(), "dopry")
    refused("has an unknown form", mb.propagate, DECAY, "vertex:3", BOX)


@pytest.mark.parametrize(
    ("text", "solver"),
    [("cvodes:1e-9", mb.CVODES(rtol=1e-9)), ("dopri", mb.DormandPrince()), ("rk:50", mb.RungeKutta(steps=50))],
)
def test_solvers_by_their_texts(text, solver):
    assert mb.simulate(scene(), text).solver == repr(solver)
    assert mb.prepare(scene(), text).solver == solver
    assert mb.propagate(scene(box=mb.Box(stiffness=(5.0, 5.5))), "vertex", solver=text).solver == repr(solver)


def test_bounds_of_an_output_by_its_name():
    bounds = mb.propagate(DECAY, box=BOX)
    for again in (bounds, pickle.loads(pickle.dumps(bounds)), copy.deepcopy(bounds), copy.copy(bounds)):
        for k, name in enumerate(bounds.names):
            for ends, both in zip((again.lower, again.upper), bounds[name], strict=True):
                np.testing.assert_array_equal(ends[name], both)
                assert type(ends[name]) is type(ends[:, k]) is type(ends + 1.0) is np.ndarray
            for ends in (again.lower, again.upper):
                with pytest.raises(ValueError, match="read-only"):
                    ends[0, 0] = 1.0
                for mine in (ends.copy(), copy.copy(ends)):
                    mine["y"][:] = 5.0
                    assert (mine["y"] == mine[:, 1]).all() and (mine["y"] == 5).all() and (ends["y"] != 5).all()
    refused("no output 'z'. Known are: x, y", bounds.lower.__getitem__, "z")
    refused("no output 'x'", bounds.lower.T.__getitem__, "x")
    assert isinstance(bounds.lower.max(), float) and isinstance(bounds.lower[0, 0], float)


def test_runs_are_evaluations():
    bounds = mb.propagate(DECAY, "scan:6", BOX)
    assert bounds.runs == bounds.evaluations == 6
    assert [row.runs for row in mb.compare(DECAY, ["mc:9", "vertex"], BOX).rows] == [9, 2]
    found = mb.tolerances(DECAY, {"y": (None, 1.7)}, BOX)
    assert found.runs == found.evaluations > 0


@pytest.mark.parametrize("tolerances", [{"rtol": 1e-6}, {"rtol": 1e-11}, {"atol": 1e-7}, {"rtol": 1e-6, "atol": 1e-9}])
def test_tolerances_go_to_the_default_solver(tolerances):
    default, given = mb.simulate(scene()), mb.simulate(scene(), **tolerances)
    assert default.solver == "DormandPrince(rtol=1e-11)"
    assert given.solver == repr(mb.DormandPrince(**{"rtol": 1e-11} | tolerances))
    exact = 0.4 * np.cos(np.sqrt(5.3 / 0.7) * given.t)
    assert np.abs(given["x"] - exact).max() < 1e3 * max(tolerances.get("rtol", 1e-10), tolerances.get("atol", 0.0))


def test_tolerances_of_impacts_figures_and_several_runs():
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    floor = mb.Impact("floor", ball.y, 0.5)
    falls = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81), floor), {"ball.y": 0.3}, [0.0, 0.5], {"y": ball.y})
    assert mb.simulate(falls, rtol=1e-7).solver == repr(mb.EventDriven(rtol=1e-7))
    mass, spring = oscillator()
    peak = mb.Scene(mb.System(mass, spring), {"mass.x": 0.4}, [0.0, 2.0], {"peak": mb.maximum(mass.vx)})
    assert mb.simulate(peak, rtol=1e-10)["peak"] == pytest.approx(0.4 * np.sqrt(5.3 / 0.7), rel=1e-6)
    rough, fine = (mb.simulate(scene(), parameters=[{"mass": 0.5}], rtol=rtol)["x"][0] for rtol in (1e-4, 1e-11))
    exact = 0.4 * np.cos(np.sqrt(5.3 / 0.5) * np.linspace(0.0, 2.0, 5))
    assert np.abs(fine - exact).max() < 1e-9 < np.abs(rough - exact).max()


@pytest.mark.parametrize("subject", [scene, lambda: mb.prepare(scene(), "dopri")])
def test_tolerances_beside_a_solver_are_refused(subject):
    subject = subject()
    solver = None if isinstance(subject, mb.DAESimulator) else mb.DormandPrince()
    refused("rtol= and atol= apply to the default solver", mb.simulate, subject, solver, rtol=1e-5)
    refused("rtol=2 must be a number", mb.simulate, scene(), rtol=2)


@pytest.mark.parametrize(("text", "share"), [("5%", 0.05), (" 12.5 %", 0.125), ("0.3%", 0.003)])
def test_boxes_around_nominal_values_by_percent(text, share):
    assert mb.Box.around(P, text) == mb.Box.around(P, share)
    assert mb.Box.around(P, text, ["mass"]) == mb.Box.around(P, share, ["mass"])


@pytest.mark.parametrize("text", ["5", "x%", "0%", "100%", "-5%", "nan%", "%", ""])
def test_shares_that_are_none_are_refused(text):
    refused("spread must be above 0 and below 1", mb.Box.around, P, text)


def test_a_system_finds_the_parameters_of_its_elements():
    mass, spring = oscillator()
    assert mb.System(mass, spring).parameters is P
    assert [*pickle.loads(pickle.dumps(mb.System(mass, spring))).parameters] == [*P]
    rod = mb.Body("rod", 1.0, 0.2)
    for element in (
        mb.Revolute("pin", mb.Ground().point(0, 0), rod.point(-P.mass, 0)),
        mb.Force("push", rod.point(0, 0), (0, P.stiffness * mb.t)),
        mb.Impact("wall", rod.x, P.unused),
        mb.State("z", rate=lambda z: -P.mass * z),
        mb.Gravity(0, -P.unused),
    ):
        assert mb.System(rod, element).parameters is P
    assert len(mb.System(rod).parameters) == 0


def test_parameters_of_two_kinds_or_beside_the_elements_are_named():
    other = mb.Parameters(c=1.0)
    mass, spring = oscillator()
    damper = mb.Damper("damper", mb.Ground().point(0, 0), mass.point(0, 0), other.c)
    told = "belongs to Parameters that the System does not have. Declare all parameters in one object"
    refused(told, mb.System, mass, spring, damper)
    refused(told, mb.System, mass, spring, parameters=other)
    refused(told, mb.Scene, mb.System(mass, spring), outputs={"y": other.c * mass.x})


def test_elements_made_inside_belong_to_the_system():
    with mb.System() as system:
        mass, spring = oscillator()
    after = mb.Body("after", 1.0)
    listed = mb.System(mass, spring, parameters=P)
    assert system.elements == (mass, spring) and after not in system.elements
    assert system.parameters is P
    for part in ("M", "Q", "q"):
        assert ca.is_equal(getattr(system, part), getattr(listed, part), 20)
    assert [e.name for e in pickle.loads(pickle.dumps(system)).elements] == ["mass", "spring"]


def test_blocks_within_each_other_and_those_that_end_by_an_error():
    with mb.System(parameters=P) as outer:
        first = mb.Body("first", 1.0, 1.0)
        with mb.System() as inner:
            second = mb.Body("second", P.mass, 1.0)
        third = mb.Revolute("third", mb.Ground().point(0, 0), first.point(1, 0))
    assert outer.elements == (first, third) and outer.parameters is P
    assert inner.elements == (second,)
    with pytest.raises(ZeroDivisionError), mb.System():
        mb.Body("a", 1.0 / 0, 1.0)
    with pytest.raises(mb.DeclarationError, match="the name is used twice"), mb.System():
        mb.Body("a", 1.0, 1.0), mb.Body("a", 1.0, 1.0)


def test_a_system_is_not_used_inside_its_block():
    again = mb.Body("again", 1.0, 1.0)
    with mb.System() as system:
        mass, _ = oscillator()
        uses = {
            "M": lambda: system.M, "elements": lambda: system.elements, "inputs": lambda: system.inputs,
            "joint_space": system.joint_space, "reaction": lambda: system.reaction("spring"),
            "pickle": lambda: pickle.dumps(system), "scene": lambda: mb.Scene(system, outputs={"x": mass.x}),
            "equations": system.equations, "with_states": lambda: system.with_states([]),
        }  # fmt: skip
        for use in uses.values():
            refused(r"^System: a System cannot be used inside its own block. Use it after the block.$", use)
        with pytest.raises(mb.DeclarationError, match="the block of this System is already open"), system:
            mb.Body("inside", 1.0, 1.0)
        last = mb.Gravity(0, -9.81)
    assert len(system.elements) == 3 and system.elements[-1] is last and system.M.shape == (3, 3)
    with system:
        more = mb.Body("more", 1.0, 1.0)
    assert system.elements[-1] is more and system.M.shape == (6, 6)
    with pytest.raises(mb.DeclarationError, match="the name is used twice"), system:
        mb.Body("again", 1.0, 1.0), mb.Body("again", 2.0, 1.0)
    with pytest.raises(ZeroDivisionError), system:
        mb.Body("gone", 1.0 / 0, 1.0)
    assert system.elements[-1] is more and system.M.shape == (6, 6) and again not in system.elements
    with pytest.raises(AttributeError, match="System has no attribute 'Mass'"):
        _ = system.Mass  # pyright: ignore


def test_machines_of_files_belong_to_the_system_once(tmp_path):
    (tmp_path / "arm.urdf").write_text(
        """<robot name="arm"><link name="wall"/><link name="rod"><inertial><mass value="2"/>
        <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.21"/></inertial></link>
        <joint name="hinge" type="continuous"><parent link="wall"/><child link="rod"/></joint></robot>"""
    )
    with pytest.warns(mb.SymmbWarning, match="inertia"), mb.System() as system:
        mb.load_urdf(tmp_path / "arm.urdf", replace={"rod.mass": P.mass})
        mb.Gravity(0, 0, -9.81)
    assert [e.name for e in system.elements] == ["rod", "hinge", "gravity"] and system.parameters is P
