"""Values that are not finite, very large or very small, and directions of any length."""

import casadi as ca
import numpy as np
import pytest

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
    with pytest.raises(mb.DeclarationError, match=rf"{element} 'e'.*(NaN or infinity|depends on t)"):
        pushed(element, direction)


@pytest.mark.parametrize("body", [GROUND, mb.Body("a", 1.0, (1, 2, 3), mb.Spatial(), com=(0, ca.SX(INF), 0))])
def test_points_that_are_not_finite_are_refused_by_name(body):
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    contact = mb.Contact("e", ball.point(0, 0, 0), body.point(0, NAN, 0), (0, 0, 1), STIFF)
    with pytest.raises(mb.DeclarationError, match=f"Contact 'e'.*NaN or infinity in a point of body '{body.name}'"):
        mb.System(ball, *([body] if body is not GROUND else []), contact)


@pytest.mark.parametrize("element", DIRECTED)
@pytest.mark.parametrize("size", [1e-320, 1e-200, 1e200, 1.5e308])
def test_only_the_direction_of_a_vector_counts(element, size):
    known = mb.simulate(pushed(element, (0.0, 0.0, 1.0)))
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
    with pytest.raises(mb.DeclarationError, match=f"{name}: expected one number or CasADi SX"):
        LAWS[name](value)


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
