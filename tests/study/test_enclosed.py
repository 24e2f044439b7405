"""Proved bounds limit the reference of a comparison, and other methods are checked against them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from faults import warned
from small_scenes import state

import symmb as mb
from symmb.bound.bounds.method import Method
from symmb.study import compare

T = np.linspace(0.0, 2.0, 9)
BOX = mb.Box(k=(0.9, 1.1))


def _decay():
    """z' = -k z from 2: the true bounds are 2 exp(-1.1 t) and 2 exp(-0.9 t)."""
    return state(lambda p, z: -p.k * z, T, 2.0, k=(0.9, 1.1))


TRUE = 2 * np.exp(-np.outer(T, [1.1, 0.9]))


@dataclass(frozen=True)
class Claim(Method):
    """Bounds that are farther out, or in, than the true ones, with an estimate of their error."""

    kind: ClassVar = "estimate"
    off: float = 0.0
    said: float = 0.0

    def _bounds(self, simulator, box, executor, progress):
        estimate = np.full((len(T), 1), self.said)
        return self._result(simulator, TRUE[:, :1] - self.off, TRUE[:, 1:] + self.off, 1, estimate=estimate)


@dataclass(frozen=True)
class Wrong(Claim):
    """The same as attained values."""

    kind: ClassVar = "sampled"

    def _bounds(self, simulator, box, executor, progress):
        lower, upper = TRUE[:, :1] - self.off, TRUE[:, 1:] + self.off
        return self._result(simulator, lower, upper, 1, inner=(lower, upper))


def test_the_reference_is_proved_to_be_near_the_true_bounds(tmp_path):
    found = mb.compare(_decay(), [mb.TaylorModel(order=6), mb.PolynomialChaos(order=4)], reference=mb.Scanning(2))
    reference = found.reference
    np.testing.assert_allclose(np.hstack([reference.lower, reference.upper]), TRUE, atol=1e-7)
    assert reference.proved_by == ("TaylorModel(order=6)",) and 0 < reference.proved[0] < 1e-5
    assert reference.uncertainty[0] == reference.proved[0]  # a scan alone does not know it
    assert "proved by TaylorModel(order=6): the reference misses the true bounds by at most" in str(found)
    assert not found.doubts
    found.save(tmp_path / "found.json")
    read = type(found).load(tmp_path / "found.json").reference
    assert read.proved_by == reference.proved_by and (read.proved == reference.proved).all()


def test_a_reference_ends_where_proved_bounds_end():
    found = compare.compare_simulator(mb.DAESimulator(_decay()), [mb.TaylorModel(order=6)], BOX, Claim(off=0.2))
    np.testing.assert_allclose(np.hstack([found.reference.lower, found.reference.upper]), TRUE, atol=1e-6)
    assert found.reference.proved is None  # what is not attained may miss either way


def test_a_reference_must_be_finite():
    scene = state(lambda p, z: p.k * z**2, [0.0, 0.5, 0.9, 1.0], 1.0, k=(0.9, 1.1))
    with pytest.raises(mb.PropagationError, match=r"TaylorModel\(order=4\) has infinite bounds of z at t = 0.9 s"):
        mb.compare(scene, [mb.Vertex()], reference=mb.TaylorModel(order=4))


def test_runs_outside_of_proved_bounds_are_told():
    told = r"Runs of Wrong\(off=0.01, said=0.0\) are outside .*: z by 1.0e-02 at t = "
    found = warned(told, mb.compare, _decay(), [mb.TaylorModel(order=6), Wrong(off=0.01), mb.Vertex()])
    assert len(found.doubts) == 1
    # Runs of methods belong to the reference, up to the limit.
    assert (found.reference.upper <= TRUE[:, 1:] + 1e-6).all()


def test_runs_of_the_reference_are_checked_as_well():
    warned(r"Runs of the reference Wrong", mb.compare, _decay(), [mb.TaylorModel(order=6)], reference=Wrong(off=0.01))


def test_estimates_that_are_too_low_are_told():
    methods = [mb.TaylorModel(order=6), Claim(off=0.02, said=0.03), Claim(off=0.02, said=0.01)]
    with pytest.warns(mb.SymmbWarning, match=r"Claim\(off=0.02, said=0.01\) underestimates its error"):
        found = mb.compare(_decay(), methods, reference=mb.Scanning(3))
    assert len(found.doubts) == 2 and "The estimated error is above 10 % of the width" in found.doubts[0]


def test_bounds_that_are_inside_are_not_doubtful():
    methods = [mb.TaylorModel(order=6), Claim(off=-0.05, said=0.0), Wrong(off=-0.05)]
    found = mb.compare(_decay(), methods, reference=mb.Scanning(3))
    assert not found.doubts and "Check runs show errors of the bounds: z" in found.rows[2].doubts[0]
