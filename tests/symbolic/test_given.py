"""Values that users give become SX in one place: numbers of any type are right, and others are refused."""

import casadi as ca
import numpy as np
import pytest

import symmb as mb
from symmb.declare.symbolic import given


@pytest.mark.parametrize("kind", [int, float, np.float16, np.float32, np.longdouble, np.int8, np.uint64])
def test_numbers_of_every_type(kind):
    for value in (kind(1), np.array(kind(1)), np.array([[kind(1)]]), [kind(1)], (kind(1),)):
        assert float(given(value)) == 1.0


@pytest.mark.parametrize(
    "value",
    [None, "1", b"1", 1j, 10**400, np.clongdouble(1), np.array(["a"]), np.array([1j]), np.ones((1, 1, 1)),
     [[1], [1, 2]], np.datetime64("2020-01-01"), np.timedelta64(3, "s"), ca.MX.sym("x"), {},
     object(), float, [ca.SX.sym("a"), "b"],
     np.ma.masked_array([1.0, 2.0], [True, False]), np.ma.masked, [0.0, np.ma.masked], True, np.bool_(True),
     np.array([True]), [True, 1.0], memoryview(b"x"), bytearray(b"x"), [memoryview(b"x")]],
    ids=lambda value: type(value).__name__,
)  # fmt: skip
def test_what_is_no_number(value):
    assert given(value) is None


def test_lists_of_expressions():
    a = ca.SX.sym("a")
    assert given([a, np.longdouble(2.0), ca.DM(3)]).shape == (3, 1)


@pytest.mark.parametrize(
    "declare",
    [
        lambda v, b: mb.Body("c", v, v, com=(v, 0)),
        lambda v, b: b.point(v, 0),
        lambda v, b: mb.Spring("s", mb.Ground().point(0, v), b.point(0, 0), v, 0.5),
        lambda v, b: mb.Force("f", b.point(0, 0), (v, 0)),
        lambda v, b: mb.Torque("t", b, v),
        lambda v, b: mb.ddt(v),
        lambda v, b: mb.Table([0, 1], [0, 1])(v),
        lambda v, b: mb.rotation(axis=(0, 0, v), angle=v),
    ],
)
def test_long_doubles_in_declarations(declare):
    """They ended Python itself."""
    body = mb.Body("b", 1.0, 0.1)
    made = [declare(v, body) for v in (np.longdouble(1.0), 1.0)]
    if isinstance(made[0], ca.SX):
        assert ca.is_equal(made[0], made[1], 2)
    elif hasattr(made[0], "actions"):
        runs = [mb.simulate(mb.Scene(mb.System(body, force), times=[0, 0.1]), mb.RungeKutta(steps=5)) for force in made]
        np.testing.assert_array_equal(runs[0]["b.x"], runs[1]["b.x"])
