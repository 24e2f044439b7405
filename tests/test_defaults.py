"""What may be left out, what may be written as a text, and the one form of names, wherever they come in."""

import copy
import pickle
import random
import sys
import time
import unicodedata

import casadi as ca
import numpy as np
import pytest
from faults import refused
from machines import ORIGIN, bouncing_ball
from scipy.stats import uniform

import symmb as mb
from symmb._names import name_faults, normal

T = np.linspace(0.0, 1.0, 4)
DECAY = mb.FunctionSimulator(lambda k, a: np.stack([a * np.exp(-k * T), k * T], 1), {"k": 1.3, "a": 2.0}, T, ["x", "y"])
BOX = mb.Box(k=(0.7, 1.9))
P = mb.Parameters(stiffness=5.3, unused=1.0, mass=0.7)


def oscillator():
    mass = mb.Body("mass", P.mass, pose=mb.Particle())
    return mass, mb.Spring("spring", ORIGIN, mass.point(0, 0), P.stiffness)


def scene(**more):
    elements = oscillator()
    outputs = {"x": elements[0].x} | more.pop("outputs", {})
    return mb.Scene(mb.System(*elements), {"mass.x": 0.4}, np.linspace(0.0, 2.0, 5), outputs, **more)


@pytest.mark.parametrize(
    ("text", "method"),
    [
        ("pce:3", mb.PolynomialChaos(order=3)), ("vertex", mb.Vertex()), ("mc:13", mb.MonteCarlo(13)),
        ("scan:7", mb.Scanning(7)), ("pce:2:paper", mb.PolynomialChaos.paper(order=2)), (None, mb.PolynomialChaos()),
    ],
)  # fmt: skip
def test_methods_by_their_texts_and_polynomial_chaos_without_one(text, method):
    a, b = mb.propagate(DECAY, text, BOX) if text else mb.propagate(DECAY, box=BOX), mb.propagate(DECAY, method, BOX)
    assert np.array_equal(a.lower, b.lower) and np.array_equal(a.upper, b.upper) and a.method == b.method
    comparison = mb.compare(DECAY, [text or method, "vertex"], BOX, reference="scan:9")
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
                refused("read-only", ends.__setitem__, (0, 0), 1.0, error=ValueError)
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
    falls = bouncing_ball().scene("y", [0.0, 0.5], {"ball.y": 0.3})
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
        mb.Revolute("pin", ORIGIN, rod.point(-P.mass, 0)),
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
    damper = mb.Damper("damper", ORIGIN, mass.point(0, 0), other.c)
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


def ended_blocks(system):
    """Two blocks that end by an error."""
    with pytest.raises(mb.DeclarationError, match="the name is used twice"), system:
        mb.Body("twice", 1.0, 1.0), mb.Body("twice", 2.0, 1.0)
    with pytest.raises(ZeroDivisionError), system:
        mb.Body("gone", 1.0 / 0, 1.0)


def test_blocks_within_each_other_and_those_that_end_by_an_error():
    with mb.System(parameters=P) as outer:
        first = mb.Body("first", 1.0, 1.0)
        with mb.System() as inner:
            second = mb.Body("second", P.mass, 1.0)
        third = mb.Revolute("third", ORIGIN, first.point(1, 0))
    assert outer.elements == (first, third) and outer.parameters is P
    assert inner.elements == (second,)
    ended_blocks(mb.System())


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
    ended_blocks(system)
    assert system.elements[-1] is more and system.M.shape == (6, 6) and again not in system.elements
    refused("System has no attribute 'Mass'", getattr, system, "Mass", error=AttributeError)


def test_machines_of_files_belong_to_the_system_once(tmp_path):
    text = """<robot name="arm"><link name="wall"/><link name="rod"><inertial><mass value="2"/>
        <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.21"/></inertial></link>
        <joint name="hinge" type="continuous"><parent link="wall"/><child link="rod"/></joint></robot>"""
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.warns(mb.SymmbWarning, match="inertia"), mb.System() as system:
        mb.load_urdf(tmp_path / "arm.urdf", replace={"rod.mass": P.mass})
        mb.Gravity(0, 0, -9.81)
    assert [e.name for e in system.elements] == ["rod", "hinge", "gravity"] and system.parameters is P


SAME = [*{"\u00b5": "\u03bc", "\u212a": "K", "\ufb01": "fi", "e\u0301": "\u00e9", "\u017f": "s", "\u1d65": "v"}.items()]
TIMES = np.array([0.0, 1.0])


def spring(name):
    """A mass on a spring, whose names are made of one."""
    p, bob = mb.Parameters(**{name: 2.0}), mb.Body(f"b{name}", 1.0, pose=mb.Particle())
    element = mb.Spring(f"s{name}", mb.Ground().point(0, 0), bob.point(0, 0), getattr(p, name))
    return mb.Scene(mb.System(bob, element, parameters=p), {f"b{name}.x": 1.0}, TIMES, {f"x{name}": bob.x})


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_two_forms_of_a_name_are_one_at_every_entrance(one, other, tmp_path):
    scene = spring(one)
    p = scene.system.parameters
    assert [*p] == [other] and p[one] == p[other] == 2.0 and getattr(p, one).name() == other
    run = mb.simulate(scene, mb.CVODES(), parameters={one: 3.0})
    again = mb.simulate(spring(other), mb.CVODES(), parameters={other: 3.0})
    assert run[f"x{one}"].tobytes() == again[f"x{other}"].tobytes()
    assert str(scene.system.force(f"s{one}")) == str(scene.system.force(f"s{other}"))
    assert mb.Box(**{one: (1.0, 2.0)}) == mb.Box(**{other: (1.0, 2.0)}) == mb.Box.plus_minus({one: 1.5}, **{other: 0.5})
    assert mb.sweep(scene, {one: [1.0]}, solver=mb.CVODES())[f"x{other}"].shape == (1, 2)
    (tmp_path / "table.csv").write_text(f"name,nominal,plus\n{one},1.5,0.5\n", encoding="utf-8")
    assert mb.Box.read(tmp_path / "table.csv", {other: 1.5})[one] == (1.0, 2.0)
    f = mb.FunctionSimulator(lambda **values: values[other], {one: 1.0}, [0.0], [one])
    assert mb.propagate(f, mb.Vertex(), mb.Box(**{other: (0.0, 1.0)})).check({one: (None, 0.5)}).kept is False


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_laws_know_both_forms(one, other):
    f = mb.FunctionSimulator(lambda **values: values[other], {one: 1.0}, [0.0], ["y"])
    box, law = mb.Box(**{one: (0.0, 1.0)}), uniform(0.0, 1.0)
    bounds = mb.propagate(f, mb.PolynomialChaos(), box)
    found = [bounds.quantiles("y", [0.3], laws={name: law}).lower.tobytes() for name in (one, other)]
    assert found[0] == found[1]
    for sampling in (mb.MonteCarlo(9, laws={name: law}) for name in (one, other)):
        assert mb.propagate(f, sampling, box)["y"][0].shape == (1,)
    refused("twice", bounds.probability, "y", above=0.5, laws={one: law, other: law})


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_results_are_looked_up_in_both_forms(one, other, tmp_path):
    scene = spring(one)
    other_p = scene.system.parameters.with_nominal({one: 3.0})
    run = mb.simulate(scene, mb.CVODES())
    run.save(tmp_path / "run.json")
    fit = mb.calibrate(scene, {f"x{one}": run.values[:, 0]}, solver=mb.CVODES(), noise={f"x{one}": 0.1})
    linear = mb.linearize(scene)
    f = mb.FunctionSimulator(lambda **values: np.array([values[other]]), {one: 1.0}, [0.0], [one])
    widest = mb.tolerances(f, {one: (0.5, None)}, mb.Box(**{one: (0.9, 1.1)}), costs={one: lambda h: 1 / h})
    dictionaries = [run.parameters, mb.Trajectory.load(tmp_path / "run.json").parameters, fit.parameters, fit.laws]
    dictionaries += [fit.deviations, linear.parameters, widest.factors, widest.nominal, f.parameters]
    dictionaries += [mb.sweep(f, {one: [1.0]}).parameters, pickle.loads(pickle.dumps(fit)).parameters]
    for known in dictionaries:
        assert [*known] == [other] and known[one] is known[other] is known.get(one) and one in known
        assert known == dict(known) and "none" not in known and known.get("none", 5) == 5
        with pytest.raises(KeyError):
            known["none"]
    assert other_p[one] == 3.0 and fit.noise[f"x{one}"] == 0.1


@pytest.mark.parametrize(("one", "other"), SAME, ids=ascii)
def test_two_forms_at_once_are_refused(one, other):
    bodies = [mb.Body(name, 1.0, pose=mb.Particle()) for name in (one, other)]
    scene = spring(one)
    for call in (
        lambda: mb.Parameters(**{one: 1.0, other: 2.0}),
        lambda: mb.Box(**{one: (0, 1), other: (1, 2)}),
        lambda: scene.with_outputs({one: bodies[0].x, other: bodies[0].x}),
        lambda: mb.simulate(scene, parameters={one: 1.0, other: 2.0}),
        lambda: mb.System(*bodies),
        lambda: mb.FunctionSimulator(len, {"a": 1.0}, [0.0], [one, other]),
    ):
        refused("twice", call)


def test_letters_have_the_form_of_identifiers_and_other_signs_stay():
    choice, letters = random.Random(0), [chr(k) for k in range(sys.maxunicode) if f"_{chr(k)}".isidentifier()]
    for _ in range(2000):
        word = "".join(choice.choices(letters, k=4))
        assert normal(word) == unicodedata.normalize("NFKC", word) == normal(normal(word))
    assert [normal(name) for name in ("v²", "CO₂", "½", "a–b")] == ["v²", "CO₂", "½", "a–b"]


def test_many_names_are_checked_in_a_moment():
    begin = time.process_time()
    assert name_faults([f"y{k}" for k in range(20_000)]) == []
    assert time.process_time() - begin < 1.0
