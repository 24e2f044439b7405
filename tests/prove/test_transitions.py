"""Maps of fronts: values of the map at states of the front are states of the new one."""

import casadi as ca
import numpy as np
from enclosure_samples import ode
from numpy.polynomial.chebyshev import chebval

from symmb.prove.front import Front
from symmb.prove.start import drifted, mapped


def test_states_of_a_front_are_mapped_into_the_new_one():
    rng, n, lengths, of_frame = np.random.default_rng(0), 3, 6, 4
    problem = ode(lambda x, p, t: [0 * x[0]] * n, lambda p: [0.0] * n, [(0.9, 1.1)], [0.0, 1.0])
    decay = 0.3 ** np.arange(lengths)
    old = Front(
        0.7, rng.normal(size=(n, lengths)) * decay, rng.normal(size=(n, n, of_frame)) * decay[:of_frame],
        np.array([0.02, 0.01, 0.03]), np.full(n, 1e-3), np.full((n, n), 1e-2),
    )  # fmt: skip
    x, p, t = ca.SX.sym("x", n), ca.SX.sym("p"), ca.SX.sym("t")
    f = ca.Function("f", [x, p, t], [ca.vertcat(x[0], ca.sin(x[0] + p * t) * x[1], x[2] ** 2 + ca.exp(x[1]))])
    new = mapped(problem, old, f)
    allowed, largest = new.x_error + new.B_error @ new.w, 0.0
    for _ in range(2000):
        xi, w = rng.uniform(-1, 1), old.w * rng.choice([-1.0, 1.0], n)
        off = 0.999 * rng.choice([-1.0, 1.0], n) * (old.x_error + old.B_error @ old.w)
        at, there = (chebval(xi, front.x.T) + chebval(xi, np.moveaxis(front.B, 2, 0)) @ w for front in (old, new))
        error = np.abs(f(at + off, 1.0 + 0.1 * xi, 0.7).full().ravel() - there)
        assert (error <= allowed).all()
        largest = np.maximum(largest, error / allowed)
    assert (largest > 0.2).all()  # bounds are not much too wide


def test_a_front_at_a_time_that_is_late():
    """x' = -x: within 1e-12 s states change by as much of their size."""
    problem = ode(lambda x, p, t: [-x[0]], lambda p: [p[0]], [(0.9, 1.1)], [0.0, 1.0])
    still = Front(0.5, np.array([[2.0, 0.1]]), np.ones((1, 1, 1)), np.zeros(1), np.zeros(1), np.zeros((1, 1)))
    assert 2.1e-12 <= drifted(problem, still, 1e-12).x_error[0] < 2.2e-12
