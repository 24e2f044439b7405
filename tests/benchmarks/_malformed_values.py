"""Values for malformed calls: nonsense, other forms of good values, and what no call may accept.

Sizes and tiny numbers are legal for some arguments, so that a call with one of them need not be refused. What is no
number must be refused where a number is asked for, and a good number in another form must give the same result.
"""

# ruff: noqa: E501  (tables of values)

import contextlib
import datetime
import decimal
import fractions
import math
import random
import sys
from collections.abc import Mapping
from pathlib import Path
from types import GeneratorType
from typing import Any

import casadi as ca
import numpy as np
import sympy

import symmb as mb


class Odd:
    """An object without any use."""

    def __repr__(self) -> str:
        return "Odd()"


def pandas_things() -> list[Any]:
    """Objects of pandas, where it is installed."""
    try:
        import pandas as pd
    except ModuleNotFoundError:
        return []
    return [
        pd.Series([1.0, 2.0]), pd.Series([1.0, 2.0], index=["l", "k"]), pd.Series(["a"]), pd.Series([], dtype=float), pd.Timestamp("2020-01-01"), pd.NaT, pd.NA, pd.Timedelta(1), pd.DataFrame({"l": [1.0]}),
        pd.DataFrame(), pd.Index(["x"]), pd.Categorical(["a"]), pd.date_range("2020-01-01", periods=3), pd.Interval(0, 1), pd,
    ]  # fmt: skip


NONSENSE: list[Any] = [
    None, True, "1", "", "5%", "x" * 500, "\n", b"1", 0, -1, 1, 3, 1e308, 1e-320, -0.5, 1.5, 10**30, float("nan"),
    float("inf"), 1j, [], [1], [1, 2, 3], [[1, 2], [3]], (), (0.9, 1.1), ("a", "b"), (1.1, 0.9), {}, {"l": 1}, {1: 2}, {"a": None}, set(), object(),
    Odd(), Odd, len, lambda: 1, lambda *a, **k: "text", np.array(1.0), np.zeros(0), np.zeros((2, 2)),
    np.array(["a"]), np.array([np.nan]), ca.SX.sym("z"), ca.SX.sym("z", 3), ca.MX.sym("z"), ca.DM(3), range(3), iter([1]),
    mb.Vertex, mb.Vertex(), mb.CVODES, mb.CVODES(), mb.Box(l=(0.9, 1.1)), mb.Box(k=(0, 1)), mb.Gauss(), mb.Sobol(), mb.Planar,
    mb.Parameters(q=1.0), Path("nonexistent/file"), "nonexistent/file.npz", "/", ".", "out.qqq",
    # kinds of numbers and of arrays, of other libraries too
    np.longdouble(1.5), np.float16(0.5), np.int8(3), np.uint64(2**63), np.complex64(1j), np.bool_(True), 10**400, -(10**400), decimal.Decimal("1.5"), fractions.Fraction(1, 3),
    np.datetime64("2020-01-01"), np.timedelta64(3, "s"), datetime.datetime(2020, 1, 1), datetime.date(2020, 1, 1), datetime.timedelta(1),
    np.array(["2020-01-01"], dtype="datetime64[D]"), np.array([1j, 2]), np.array([None, 1], dtype=object), np.array([True, False]), np.array([b"a"]), np.zeros((0, 2)), np.zeros((3, 0)),
    np.ones((1, 1, 1)), np.ones((2, 3)), np.ones(7), np.arange(5), np.arange(5)[::-1], np.array([1.0, np.inf]), np.ma.masked_array([1.0, 2.0], [True, False]), np.zeros(3, dtype=[("a", float)]),
    np.array([1, 2, 3], dtype=np.longdouble), np.matrix([[1.0, 2.0]]), np.random.default_rng(0), np, math, sys, contextlib, ca, mb, memoryview(b"12"), bytearray(b"12"), frozenset({1}),
    [[[1.0]]], [[1, 2], [3, 4]], [None], ["x", "x"], [""], ["x", 3], [[]], [{}], {"x": 1.0, "y": None}, {"x": [1, 2]}, {"x": {"y": 1}}, {"": 1.0}, {None: 1.0}, {("a", "b"): 1.0}, {"l": "1"}, {"l": 1j},
    {"l": np.ones(3)}, {"l": float("nan")}, {"l": (1.0, 0.5)}, {"rod.theta": "x"}, (k for k in range(3)), (c for c in "abc"), zip([1], [2], strict=True), map(abs, [1]), Ellipsis, NotImplemented, slice(1, 2),
    ca.SX(3), ca.SX.zeros(2, 2), ca.MX.zeros(3), ca.DM.ones(2, 3), ca.DM(0, 1), ca.SX.sym("z") + 1, ca.Function("f", [], []), ca.Sparsity(2, 2), ca.SX(float("nan")), [ca.SX.sym("a"), ca.SX.sym("b")],
    sympy.Symbol("w"), sympy.Matrix([1, 2]), sympy.pi, sympy.Symbol("w") ** 2 > 1, sympy.Interval(0, 1), sympy.S.NaN, sympy.oo, sympy.I, Exception("x"), ValueError, property(), staticmethod(len), type, int, float, str, list, dict,
    lambda x: x, lambda: None, lambda *a, **k: None, lambda *a, **k: object(), lambda *a, **k: "a", lambda *a, **k: [1, 2, 3], lambda *a, **k: 1 / 0, lambda *a, **k: np.zeros((2, 2)), "\ud800", "a\0b", "x/y", "é", "..", "~", "nan", "inf", "None", "/dev/null", "/proc/self/mem", "a" * 300 + ".npz",
    *pandas_things(),
]  # fmt: skip


def odd_values() -> list[Any]:
    """Values that are nearly what a call asks for: other kinds of numbers, times, buffers, and sizes of 10**k."""
    whole = [np.int8, np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.int64, np.uint64]
    fixed = np.arange(3.0)
    fixed.flags.writeable = False
    frozen = np.array([0.0, 0.1, 0.2])
    frozen.flags.writeable = False
    return [
        *[kind(100) for kind in whole], *[np.iinfo(kind).max for kind in whole], *[kind(np.iinfo(kind).max) for kind in whole], np.int8(-128), np.int64(-(2**63)),
        *[10**k for k in range(2, 40, 3)], *[-(10**k) for k in range(2, 40, 12)], *[10.0**k for k in range(-320, 309, 24)], *[-(10.0**k) for k in (-300, 0, 100, 308)], 10**400, 5e-324, np.finfo(float).max,
        *[np.longdouble(x) for x in (0, 1, -1, 0.5, "1e400", "1e-4000", "nan", "inf")], np.array(1, dtype=np.longdouble), np.arange(3, dtype=np.longdouble), np.longdouble("1e-5"), np.clongdouble(1j), np.float16(65504), np.float32(0.1),
        [np.longdouble(0), np.longdouble(1)], (np.longdouble(0), 0, 1), {"l": np.longdouble(1)}, {"rod.theta": np.longdouble(0.1)}, {"x": np.longdouble(1)}, [ca.SX.sym("a"), np.longdouble(1)],
        np.ma.masked, [0, np.ma.masked], {"l": np.ma.masked}, {"rod.theta": np.ma.masked}, {"x": np.ma.masked}, np.ma.masked_array(1.0, True), np.ma.masked_all(3), np.ma.array([0, 1, 2]),
        memoryview(b"x"), memoryview(b"012"), bytearray(b"x"), [memoryview(b"x"), 1], memoryview(np.arange(3.0)), {"l": memoryview(b"x")}, {"x": memoryview(b"x")}, {"rod.theta": b"x"},
        True, False, np.True_, np.False_, [True, False], (False, True), (True, 0, 0), {"l": True}, {"rod.theta": True}, {"x": True}, np.array([False, True]), np.array(True), [0, True], "no", "False", "true",
        [[1, 2], [3]], [[0.0], 1.0], [1, [2]], np.array([1, [2, 3]], dtype=object), [np.zeros(2), np.zeros(3)], [(0, 0, 0), (1, 0)], {"l": [1, [2]]},
        fixed, frozen, np.asfortranarray(np.ones((2, 3))), np.arange(6.0)[::2], np.broadcast_to(1.0, (3,)), np.broadcast_to(1.0, (10**9,)), np.arange(3, dtype=">f8"), np.arange(3, dtype=np.int8), range(10**12), range(10**6),
        np.timedelta64(1, "ns"), np.datetime64("NaT"), np.array([0, 1, 2], dtype="timedelta64[s]"), np.arange("2020-01", "2020-04", dtype="datetime64[M]"), datetime.timedelta(seconds=1), datetime.time(1), [datetime.timedelta(0), datetime.timedelta(1)],
        "http://[::1", "a" * 10_000, {f"k{i}": 1.0 for i in range(1000)}, [0.0, 1e-320], [0.0, 1e308], [-1e308, 1e308], [1e300, 1.0000000000000002e300], [0, 5e-324, 1e-323],
    ]  # fmt: skip


def odd_pandas() -> list[Any]:
    """What tables of pandas give where a list of numbers or of times is asked for."""
    try:
        import pandas as pd
    except ModuleNotFoundError:
        return []
    return [
        pd.Series([0.0, 0.1, 0.2]), pd.Series([0.0, 0.1], index=[5, 3]), pd.Series([1, None, 3], dtype="Int64"), pd.Series([True, False]), pd.Series([1.0]), pd.Series({"l": 1.0}), pd.Series({"l": 1.0, "k": 2.0}),
        pd.to_timedelta([0, 1, 2], unit="s"), pd.timedelta_range("0s", periods=3, freq="s"), pd.Series(pd.to_timedelta([0, 1], unit="s")), pd.date_range("2020-01-01", periods=3, freq="s"), pd.RangeIndex(3), pd.Index([0.0, 0.1]),
        pd.DataFrame({"time": [0.0, 1.0], "x": [1.0, 2.0]}), pd.DataFrame({"l": [1.0], "k": [5.0]}), pd.Timestamp(0), pd.Timedelta(seconds=1), {"l": pd.Series([1.0])}, {"l": pd.NA}, {"x": pd.Series([1.0])}, pd.array([1, None]),
    ]  # fmt: skip


ODD: list[Any] = [*odd_values(), *odd_pandas()]


def other_form(good: Any, choice: random.Random) -> Any:
    """A good number or array in another form, of the same value; None if it has none."""
    if isinstance(good, bool | np.bool_):
        return np.bool_(good)
    if isinstance(good, int):
        widths = [kind for kind in WHOLE if np.iinfo(kind).min <= good <= np.iinfo(kind).max]
        return choice.choice(widths)(good)
    if isinstance(good, float):
        return choice.choice([np.float64, np.longdouble, *([np.float32] if float(np.float32(good)) == good else [])])(
            good
        )
    if isinstance(good, list | tuple) and good and all(isinstance(entry, int | float) for entry in good):
        good = np.array(good)
    if isinstance(good, np.ndarray) and good.dtype.kind in "if":
        still = good.copy()
        still.flags.writeable = False
        spread = np.repeat(good, 2, axis=-1)[..., ::2]
        return choice.choice(
            [
                still,
                spread,
                np.asfortranarray(good),
                good.astype(np.longdouble),
                good.tolist(),
                good.astype(">f8"),
                np.ma.array(good),
            ]
        )
    if isinstance(good, dict) and good and all(isinstance(value, float) for value in good.values()):
        return {key: choice.choice([np.float64, np.longdouble])(value) for key, value in good.items()}
    return None


WHOLE = (np.int8, np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.int64, np.uint64)


def is_wrong(good: Any, value: Any) -> bool:
    """Whether a call that takes a value must not: it is of another kind than the good one. None is a default."""
    if value is None:
        return False
    if isinstance(good, bool):
        return not isinstance(value, bool | np.bool_)
    if isinstance(good, int | float) or (isinstance(good, np.ndarray) and good.size):
        return _is_no_number(value) or (isinstance(good, int) and isinstance(value, float) and value % 1 != 0)
    if isinstance(good, list | tuple) and good and all(isinstance(entry, int | float | tuple) for entry in good):
        return _is_no_number(value)
    if isinstance(good, dict) and good:
        wanted = next(iter(good.values()))
        return not isinstance(value, Mapping) or any(is_wrong(wanted, entry) for entry in value.values())
    if isinstance(good, ca.SX):
        return _is_no_number(value)
    return isinstance(good, str) and not isinstance(value, str | Path)


def _is_no_number(value: Any) -> bool:
    """Whether something is no real number, no expression, and no list or array of these."""
    if isinstance(value, list | tuple):
        return any(map(_is_no_number, value))
    if isinstance(
        value,
        str
        | bytes
        | bytearray
        | memoryview
        | bool
        | np.bool_
        | complex
        | np.complexfloating
        | np.timedelta64
        | np.datetime64,
    ):
        return True
    if np.ma.is_masked(value):
        return True
    if isinstance(value, float | np.floating):
        return bool(np.isnan(value))
    if isinstance(value, np.ndarray):
        return value.dtype.kind not in "iuf" or bool(np.isnan(value).any())
    if hasattr(value, "dtype") and hasattr(value, "to_numpy"):
        return value.dtype.kind not in "iuf"
    return isinstance(
        value, type | dict | set | frozenset | GeneratorType | datetime.date | datetime.timedelta | datetime.time
    )
