"""Box: declaration, faults, the map to the unit box."""

import copy
import math
import pickle

import numpy as np
import pytest
from faults import refused

from symmb import Box, Parameters


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box(), "at least one interval"),
        (lambda: Box(a=(2, 1)), "'a' has lower 2.0 above upper 1.0"),
        (lambda: Box(a=(0, float("nan"))), "'a' must be finite"),
        (lambda: Box(a=(0, float("inf"))), "'a' must be finite"),
        (lambda: Box(a=1.0), "'a' must be a pair"),
        (lambda: Box(a=(1, 2, 3)), "'a' must be a pair"),
        (lambda: Box.around({"a": 0.0}, 0.1), "nominal value of 'a' is 0"),
        (lambda: Box.around({"alpha": 1.0}, 0.1, ["alpa"]), "unknown parameter 'alpa'.*'alpha'"),
        (lambda: Box.around({"a": 1.0}, -0.1), "spread must be above 0 and below 1"),
        (lambda: Box.around({"a": 1.0}, float("nan")), "spread must be above 0 and below 1"),
        (lambda: Box.around({"a": 1.0}, 1.0), r"spread must be above 0.*got 1\.0.*Box\(name=\(lower, upper\)\)"),
    ],
)
def test_faults(make, message):
    refused(message, make)


def test_around():
    box = Box.around({"a": 2.0, "b": -1.0, "c": 0.0}, 0.1, names=["b", "a"])
    assert box.names == ("b", "a")
    np.testing.assert_allclose(box.bounds, [(-1.1, -0.9), (1.8, 2.2)])


def test_tolerances_in_percent_are_known():
    parameters = Parameters(k=(2.0, "N/mm"), l=(40.0, "mm"), m=1.0)
    box = Box.plus_minus(parameters, k="10%", l="0.5 mm") | Box(m="1 kg ±2%")
    assert box.percents == {"k", "m"}
    rest = box.without("k")
    assert rest is not None and rest.percents == {"m"}
    assert Box.around(parameters, 0.1).with_units({"k": "N/m", "l": "m"}).percents == {"k", "l", "m"}
    assert Box(k=(1.8, 2.2)) == Box.around({"k": 2.0}, 0.1) and not Box(k=(1.8, 2.2)).percents


def test_unit_box_and_back():
    box = Box(a=(0.1, 0.7), b=(-3, 5), fixed=(2, 2))
    unit = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    unit[:, 2] = 0
    np.testing.assert_allclose(box.to_unit(box.from_unit(unit)), unit, atol=1e-14)
    np.testing.assert_array_equal(box.from_unit([[-1, -1, -1], [1, 1, 1]]), [box.lower, box.upper])


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("way", ["to_unit", "from_unit"])
def test_points_that_are_not_finite_are_refused(way, value):
    refused("must be finite numbers", getattr(Box(a=(0.1, 0.7), b=(-3, 5)), way), [[0.2, value]])


def test_equal_by_value_and_picklable():
    assert Box(a=(0, 1)) == Box(a=(0.0, 1.0)) != Box(a=(0, 2))
    assert pickle.loads(pickle.dumps(Box(a=(0, 1)))) == Box(a=(0, 1))
    assert repr(Box(a=(0, 1), b=(0.95, 1.05))) == "Box(a=(0, 1), b=(0.95, 1.05))"


def test_constraints_are_pickled_by_name_and_lambdas_are_told():
    named = Box(a=(0, 1), constraints=[math.sin])
    assert pickle.loads(pickle.dumps(named)) == named
    own = Box(a=(0, 1), constraints=[lambda p: p.a < 0.5])
    refused("constraint <lambda> cannot be pickled. Use functions of a module", pickle.dumps, own)
    assert copy.deepcopy(own) == own == copy.copy(own)


def test_intervals_by_name():
    box = Box(l1=(0.95, 1.05), m=(2.0, 4.0))
    assert box["m"] == (2.0, 4.0) and "l1" in box and "q" not in box
    assert [*box] == list(box) == list(box.keys()) == np.array(box).tolist() == ["l1", "m"]
    first, second = box
    assert (first, second, len(box)) == ("l1", "m", 2)
    assert dict(box) == {"l1": (0.95, 1.05), "m": (2.0, 4.0)} and Box(**box) == box


@pytest.mark.parametrize("name", ["l2", 0, slice(None), None, np.zeros(2)], ids=repr)
def test_unknown_interval_is_told(name):
    box = Box(l1=(0.95, 1.05), m=(2.0, 4.0))
    refused(r"Box: no interval of .*\. (Did you mean 'l1'\?|Known are: l1, m\.)", lambda: box[name])
