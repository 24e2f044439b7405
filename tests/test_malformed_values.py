"""Values that are not finite, very large or very small, and directions of any length."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from conftest import but_long
from faults import refused, told_in_a_line

import symmb as mb

NAN, INF = float("nan"), float("inf")
STIFF = mb.KelvinVoigt(1e4, 10.0)
GROUND = mb.Ground()
DIRECTED = {
    "Contact": lambda a, b, n: mb.Contact("e", b, a, n, STIFF),
    "Soil": lambda a, b, n: mb.Soil("e", a, b, n, STIFF),
    "BushContact": lambda a, b, n: mb.BushContact("e", a, b, n, 1e-3, STIFF),
    "ToothContact": lambda a, b, n: mb.ToothContact("e", a, b, n, 1e-3, STIFF),
    "TorsionContact": lambda a, b, n: mb.TorsionContact("e", a.body, b.body, 0.1, STIFF, axis=n),
    "TorsionSpring": lambda a, b, n: mb.TorsionSpring("e", a.body, b.body, 1.0, axis=n),
    "Friction": lambda a, b, n: mb.Friction("e", a, b, n, 1.0, mb.Coulomb(0.1, speed=0.01)),
    "Revolute": lambda a, b, n: mb.Revolute("e", a, b, n),
    "Prismatic": lambda a, b, n: mb.Prismatic("e", a, b, n, (0, 0, 1)),
    "Universal": lambda a, b, n: mb.Universal("e", a, b, (1, 0, 0), n),
}


def pushed(element, direction):
    """A body on one element that is pushed and turned in all directions."""
    body = mb.Body("b", 1.0, (1, 2, 3), mb.Spatial())
    joint = DIRECTED[element](GROUND.point(0, 0, 0), body.point(0, 0, 0), direction)
    forces = mb.Gravity(1, 2, -9.81), mb.Torque("torque", body, (0.1, 0.2, 0.3))
    outputs = {"x": body.x, "z": body.z, "vy": body.vy, "wz": body.omega[2]}
    start = {} if element in ("Revolute", "Prismatic", "Universal") else {"b.z": 0.01, "b.vz": -1.0}
    return mb.Scene(mb.System(body, joint, *forces), start, np.linspace(0, 0.2, 5), outputs)


@pytest.mark.parametrize("element", DIRECTED)
@pytest.mark.parametrize(
    "direction",
    [(0, 0, NAN), (0, INF, 1), (0, 0, -INF), (0, ca.SX(NAN), 1), (0, 0, mb.t / 0), (ca.sin(mb.t) * NAN, 0, 1)],
)
def test_directions_that_are_not_finite_are_refused_by_name(element, direction):
    refused(rf"{element} 'e'.*(NaN or infinity|depends on t)", pushed, element, direction)


@pytest.mark.parametrize("body", [GROUND, mb.Body("a", 1.0, (1, 2, 3), mb.Spatial(), com=(0, ca.SX(INF), 0))])
def test_points_that_are_not_finite_are_refused_by_name(body):
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    contact = mb.Contact("e", ball.point(0, 0, 0), body.point(0, NAN, 0), (0, 0, 1), STIFF)
    with told_in_a_line(f"Contact 'e'.*a point of body '{body.name}' contains NaN or infinity"):
        mb.System(ball, *([body] if body is not GROUND else []), contact)


@cache
def along_z(element):
    return mb.simulate(pushed(element, (0.0, 0.0, 1.0)))


@pytest.mark.parametrize("element", DIRECTED)
@pytest.mark.parametrize("size", but_long([1e-320, 1e-200, 1e200, 1.5e308], 1e-200, 1e200))
def test_only_the_direction_of_a_vector_counts(element, size):
    known = along_z(element)
    run = mb.simulate(pushed(element, (0.0, 0.0, size)))
    assert all(np.array_equal(run[name], known[name]) for name in known.names)


def test_oblique_directions_of_any_size():
    for size in (1e-200, 1e200):
        rotations = [mb.rotation((3 * s, 0, 4 * s), 0.3).quaternion for s in (1.0, size)]
        assert np.allclose(ca.DM(rotations[0]), ca.DM(rotations[1]), rtol=1e-15, atol=0)


LAWS = {
    "pressure": lambda value: mb.GasSpring(value, 1e-3, 1e-3, 0.3)(mb.t, mb.t),
    "exponent": lambda value: mb.GasSpring(1e5, 1e-3, 1e-3, 0.3, value)(mb.t, mb.t),
    "length": lambda value: mb.GasSpring(1e5, 1e-3, 1e-3, 0.3)(value, mb.t),
    "area": lambda value: mb.Orifice(value, 1e-4)(mb.t, mb.t),
    "rate": lambda value: mb.Orifice(1e-3, 1e-4)(mb.t, value),
    "opening": lambda value: mb.Orifice(1e-3, lambda stroke, rate: value)(mb.t, mb.t),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("value", [None, [1.0, 2.0], "a", 1j, True, ca.SX.sym("v", 2), object()])
def test_laws_that_are_called_with_what_is_no_number(name, value):
    refused(f"{name}: expected one number or CasADi SX", LAWS[name], value)


CALLS = LAWS | {
    "KelvinVoigt": lambda value: mb.KelvinVoigt(value).force(mb.t, mb.t),
    "HuntCrossley": lambda value: mb.HuntCrossley(1.0, 0.5, value, value).force(mb.t, mb.t),
    "Coulomb": lambda value: mb.Coulomb(value, value, value).resistance("name", mb.t, mb.t)[0],
    "Bristle": lambda value: mb.Bristle(value, value, value).resistance("name", mb.t, mb.t)[0],
    "Tabulated": lambda value: mb.Tabulated(mb.Table([0, 1], [0, 1]), value).force(mb.t, mb.t),
}


@pytest.mark.parametrize("name", CALLS)
def test_long_doubles_in_laws_are_numbers(name):
    assert str(CALLS[name](np.longdouble(1.25))) == str(CALLS[name](1.25))


TIMES = np.linspace(0.0, 1.0, 3)
DECAY = mb.FunctionSimulator(lambda k: np.exp(-k * TIMES), {"k": 1.0, "c": 1.0}, TIMES, ["x"])
BOX = mb.Box(k=(0.9, 1.1), c=(0.9, 1.1))
LARGE = {n: (mb.Scanning(n), "Scanning.* takes .* runs, more than") for n in (10**5, 10**9, 10**18, 2**63, 10**400)}
LARGE[0] = mb.PolynomialChaos(order=2, nodes=mb.SparseGrid(level=10**18)), "level 1000000000000000000 is too high"


@pytest.mark.parametrize("case", LARGE, ids=lambda n: str(n)[:20])
def test_what_cannot_be_afforded_is_told_by_its_number(case):
    method, text = LARGE[case]
    refused(text, mb.propagate, DECAY, method, BOX, error=mb.PropagationError)


def test_a_taylor_model_of_too_many_boxes_is_told():
    p = mb.Parameters(m=1.0)
    body = mb.Body("b", p.m, pose=mb.Particle())
    scene = mb.Scene(mb.System(body, mb.Gravity(0, -1), parameters=p), times=[0, 1], outputs={"y": body.y})
    with pytest.raises(mb.PropagationError, match=r"takes 1\.0e\+18 runs, more than"):
        mb.propagate(scene, mb.TaylorModel(boxes=10**18), mb.Box(m=(1, 2)))


class NoText:
    def __repr__(self):
        raise OSError("no text")


def inside_itself():
    values = [ca.SX.sym("x")]
    values.append(values)
    return values


def numbers_in_itself():
    values = [1.0]
    values.append(values)
    return values


ODD = {
    "itself": inside_itself,
    "numbers in itself": numbers_in_itself,
    "no text": NoText,
    "a broadcast array": lambda: np.broadcast_to(1.0, (2, 10**12)),
}
TAKERS = {
    "Table": lambda v: mb.Table(v, [0, 1]),
    "Box": lambda v: mb.Box(k=v),
    "Box ends": lambda v: mb.Box(k=(v, 1)),
    "Box.without": lambda v: BOX.without(v),
    "Parameters": lambda v: mb.Parameters(k=v),
    "with_nominal": lambda v: mb.Parameters(k=1.0).with_nominal({"k": v}),
    "samples": lambda v: DECAY.run(v),
    "Section": lambda v: mb.Section(v, 1.0, 1.0, 1.0),
    "Beam": lambda v: mb.Beam([v, (1, 0, 0)], mb.Section.circle(0.01), mb.Material(1e9, 1e3, 0.3)),
    "Force": lambda v: mb.System(BALL, mb.Force("f", BALL.point(0, 0), v)),
    "Spring": lambda v: mb.System(BALL, mb.Spring("s", GROUND.point(0, 0), BALL.point(0, 0), v)),
    "Bushing": lambda v: mb.System(BALL, mb.Bushing("s", GROUND.point(0, 0), BALL.point(0, 0), v)),
    "point": lambda v: GROUND.point(v, 0),
    "name": lambda v: FREE.with_name(v),
    "pose": lambda v: mb.Body("b", 1.0, pose=v),
    "times": lambda v: mb.Scene(mb.System(BALL), times=v, outputs={"y": BALL.y}),
    "output": lambda v: mb.Scene(mb.System(BALL), times=[0, 1], outputs={"y": v}),
    "method": lambda v: mb.propagate(DECAY, v, BOX),
    "box": lambda v: mb.propagate(DECAY, mb.Vertex(), v),
    "executor": lambda v: mb.propagate(DECAY, mb.Vertex(), BOX, executor=v),
    "solver": lambda v: mb.simulate(FREE, v),
    "inputs": lambda v: mb.linearize(FREE, inputs=[v]),
    "outputs": lambda v: mb.linearize(FREE, outputs=[v]),
    "progress": lambda v: mb.stability(FREE, progress=v),
    "command": lambda v: mb.CommandSimulator(v, {"k": 1.0}, [0.0], ["x"]),
    "function": lambda v: mb.FunctionSimulator(v, {"k": 1.0}, [0.0], ["x"]),
    "rule": lambda v: mb.SparseGrid(v),
    "tolerance": lambda v: mb.PolynomialChaos(order=2, tolerance=v),
    "probes": lambda v: mb.PolynomialChaos(order=2, probes=v),
    "file": lambda v: mb.simulate(FREE).save(v),
}
BALL = mb.Body("ball", 1.0, pose=mb.Particle())
FREE = mb.Scene(mb.System(BALL), times=[0, 1], outputs={"y": BALL.y})


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize("odd", ODD)
def test_odd_values_are_told_in_a_sentence(taker, odd):
    with pytest.raises(mb.SymmbError):
        TAKERS[taker](ODD[odd]())


@pytest.mark.parametrize("step", [np.longdouble("1e-4000"), 0.0, -1e-3, float("inf")])
@pytest.mark.parametrize("solver", [mb.GeneralizedAlpha, mb.Newmark, mb.HHT, mb.BDFI3, mb.Rosenbrock])
def test_steps_that_are_no_doubles_above_0(solver, step):
    refused(f"{solver.__name__}: step=.* must be a number above 0", solver, step=step)


@pytest.mark.parametrize("tolerance", [1.0, 1e10, 2.0**63])
@pytest.mark.parametrize("solver", [mb.GeneralizedAlpha, mb.Newmark, mb.HHT, mb.BDFI3])
def test_tolerances_at_which_newtons_method_would_do_nothing(solver, tolerance):
    refused(r"tolerance=.* must be a number above 0 and below 1", solver, tolerance=tolerance)


@pytest.mark.parametrize("nominal", [[1], {"m": None}, {"z": 1.0}, None, {"m": float("nan")}])
def test_nominal_values_of_other_parameters(nominal):
    refused(r"with_nominal: (expected numbers for m|m: .* finite number)", mb.Parameters(m=1.0).with_nominal, nominal)


@pytest.mark.parametrize("option", ["planar", "stiffening"])
@pytest.mark.parametrize("value", ["no", 0, None, ca.DM(0)])
def test_truth_values_of_modes(option, value):
    steel = mb.Material(2e11, 7850, 0.3)
    beam = mb.FiniteElements.beams(mb.Beam([(0, 0, 0), (1, 0, 0)], mb.Section.circle(0.01), steel, 4))
    refused(f"{option} must be True or False", beam.modes, clamped=0, count=2, **{option: value})


def test_a_folder_whose_name_is_no_name():
    refused("not the name of a file", mb.DAESimulator(FREE).dae.save_c, "\ud800", error=mb.SymmbError)
