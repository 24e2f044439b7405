"""Proofs of mechanisms with loops against closed forms, and what proofs of starts and of frames rest on."""

import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from enclosure_samples import ode

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import loop_proofs

from symmb.enclosures.curves import TimeStep
from symmb.enclosures.errors import ProofError
from symmb.enclosures.flow import integrated
from symmb.enclosures.problem import StartEquations
from symmb.enclosures.start import first_front


def test_a_start_that_is_far_from_its_polynomials_is_not_proved():
    """exp(u) = 1 + p, whose approximate solution is off by 3: one step of Newton's method from it is 1 long."""
    u, p, t = (ca.SX.sym(name) for name in "upt")
    problem = ode(lambda x, p, t: [0 * x[0]], lambda p: [p[0]], [(-0.01, 0.01)], [0.0])
    start = StartEquations(
        ca.Function("residual", [u, p, t], [ca.exp(u) - 1 - p]),
        ca.Function("states", [u, p, t], [u]),
        lambda P: np.log1p(P) + 3.0,
    )
    with pytest.raises(ProofError, match="solution of the starting equations cannot be proved"):
        first_front(replace(problem, start=start), 4)


def test_an_approximate_inverse_of_a_frame_is_not_taken_as_exact():
    """C is off by a tenth of the inverse of B."""
    B = np.array([[1.0, 0.5], [0.0, 2.0]])
    C = np.diag([0.9, 1.1]) @ np.linalg.inv(B)
    problem = ode(lambda x, p, t: [0 * x[0], 0 * x[1]], lambda p: [0.0, 0.0], [(1.0, 1.0)], [0.0, 1.0])
    still, frame = (integrated(c, np.zeros((c.size, 2)), 1.0) for c in (np.zeros(2), B.ravel()))
    step = TimeStep(problem, 0.0, 1.0, still, frame, C[..., None])
    for y in ([1.0, 1.0], [1.0, 0.0], [0.0, 1.0]):
        assert (step.inverse_times(np.array(y)) >= np.abs(np.linalg.inv(B)) @ y).all()


def _told(found):
    return f"{found.kind}: outside by {found.outside:.1e}, {found.proved:.0%} proved, {found.fault} {found.refused}"


@pytest.mark.parametrize("seed", [100, 103, 106, 115, 121, 124, 125])
def test_random_mechanisms_against_closed_forms(seed):
    """Four-bars, slider-cranks and a parallelogram, free and driven."""
    found = loop_proofs.check(loop_proofs.random_case(seed), order=4, count=2)
    assert found.outside <= loop_proofs.INSIDE and not found.fault and not found.refused, _told(found)
    assert found.proved == 1.0 and found.ratio < 1.01, _told(found)


def test_a_slider_crank_that_locks_is_proved_until_then():
    """Without the test that a divisor does not vanish, its bounds are too narrow at the end (found by planting it)."""
    found = loop_proofs.check(loop_proofs.random_case(184), order=4, count=2)
    assert found.outside <= loop_proofs.INSIDE and not found.fault, _told(found)
    assert "infinite later" in found.refused and found.proved == 1.0, _told(found)


@pytest.mark.parametrize("seed", [102, 111, 113, 116, 127])
def test_boxes_with_parameters_without_a_start_are_not_proved(seed):
    """Starts at change points and beyond dead centres."""
    found = loop_proofs.check(loop_proofs.random_case(seed), order=4)
    assert not found.fault and found.refused, _told(found)
