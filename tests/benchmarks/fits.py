"""Polynomial chaos fits of 64 outputs at 1001 times in 2 parameters: one matrix product, chaospy, a plain loop.

Gauss nodes, total degree, the same node values. What does not depend on those (nodes, weights, polynomials) is made
before on every side. Seconds are the processor's, on one core.
"""

# ruff: noqa: E402  (pinned before NumPy starts its threads)
from _timing import median, pin

pin()
import chaospy
import numpy as np

from symmb import Gauss, TotalDegree
from symmb.bound.nodes.fit import Fit

OUTPUTS, TIMES = 64, 1001
t = np.linspace(0.0, 10.0, TIMES)[:, None]
rates = np.linspace(0.5, 2.0, OUTPUTS)
distribution = chaospy.J(chaospy.Uniform(-1, 1), chaospy.Uniform(-1, 1))


def responses(nodes: np.ndarray) -> np.ndarray:
    """Decaying waves (N, n_t n_y) at nodes (N, 2)."""
    return np.array(
        [((1 + 0.1 * a) * np.exp(-0.1 * rates * t) * np.cos((1 + 0.05 * b) * rates * t)).ravel() for a, b in nodes]
    )


def loop(fit: Fit, Y: np.ndarray) -> np.ndarray:
    """Coefficients (n_b, m), one polynomial and one node after the other."""
    a = np.zeros((len(fit.alpha), Y.shape[1]))
    for i, alpha in enumerate(fit.alpha):
        for value, weight, y in zip(fit.values[:, i], fit.weights, Y, strict=True):
            a[i] += value * weight * y
        a[i] *= np.prod(2 * alpha + 1)
    return a


print(f"{'order':>5s}{'nodes':>7s}{'terms':>7s}{'':4s}{'symmb':>10s}{'loop':>10s}{'chaospy':>10s}   [ms]")
for order in (2, 4, 6):
    fit = Fit.of(Gauss(), TotalDegree(), 2, order)
    ok = np.ones(len(fit.nodes), dtype=bool)
    Y = responses(fit.nodes)
    expansion = chaospy.generate_expansion(order, distribution)
    nodes, weights = chaospy.generate_quadrature(order, distribution, rule="gaussian")
    theirs = responses(nodes.T)

    def ours() -> np.ndarray:
        return fit.coefficients(fit.functionals @ Y, ok)  # noqa: B023

    found = ours()
    surrogate = chaospy.fit_quadrature(expansion, nodes, weights, theirs)
    point = np.array([0.3, -0.7])
    values = np.polynomial.legendre.legvander(point, order)
    sums = np.prod([values[k, fit.alpha[:, k]] for k in range(2)], axis=0) @ found
    assert np.abs(sums - surrogate(*point)).max() < 1e-12 and np.abs(loop(fit, Y) - found).max() < 1e-13
    seconds = [
        median(ours, repeats=21),
        median(lambda: loop(fit, Y)),  # noqa: B023
        median(lambda: chaospy.fit_quadrature(expansion, nodes, weights, theirs)),  # noqa: B023
    ]
    print(
        f"{order:5d}{len(fit.nodes):7d}{len(fit.alpha):7d}{'':4s}" + "".join(f"{1e3 * s:10.2f}" for s in seconds),
        f"  chaospy {seconds[2] / seconds[0]:.0f} times as long, the loop {seconds[1] / seconds[0]:.0f}",
        flush=True,
    )
