"""Ranges of eight functions from equally many runs: symmb beside other surrogates, and beside a search without one.

Each row is a function of two to twenty parameters with its known range, and the runs that symmb takes. The others get
as many, at Sobol points: OpenTURNS by a sparse chaos (LARS), chaospy by regression on as many polynomials as half the
runs, scikit-learn by a Gaussian process with a length for each parameter. The range of a surrogate is that of its
values at random points and of searches from the best of them. The search without a surrogate is SciPy's L-BFGS-B with
differences, from random starts until the runs are used up. Errors are the larger one at both ends, over the width.

    PYTHONPATH=. python tests/benchmarks/surrogates.py        (needs openturns, chaospy and scikit-learn)
"""

import time
import warnings
from collections.abc import Callable

import chaospy
import numpy as np
import openturns as ot
from _known_ranges import Case, cases
from scipy.optimize import minimize
from scipy.stats import qmc

import symmb as mb
from symmb._types import Array

NAMES = "oscillation 0.1", "Ishigami", "Friedman", "circuit", "piston", "borehole", "wing", "ridge 0.2"
"""Parts of the names of cases of seed 0."""
POINTS, STARTS = 5_000, 3
"""Points and searches that find the range of a surrogate."""
Surrogate = Callable[[Array], Array]


def by_symmb(case: Case) -> tuple[float, float, int]:
    """The range, and the number of runs."""
    names = [f"x{i}" for i in range(case.d)]

    def f(**p: float) -> Array:
        return case.f(np.array([list(p.values())]))[0]

    simulator = mb.FunctionSimulator(f, dict.fromkeys(names, 0.0), [0.0], ["y"])
    bounds = mb.propagate(simulator, mb.PolynomialChaos(), mb.Box(**dict.fromkeys(names, (-1.0, 1.0))))
    return float(bounds.lower[0, 0]), float(bounds.upper[0, 0]), bounds.evaluations


def by_openturns(X: Array, y: Array) -> Surrogate:
    d = X.shape[1]
    distribution = ot.JointDistribution([ot.Uniform(-1.0, 1.0)] * d)
    enumeration = ot.HyperbolicAnisotropicEnumerateFunction(d, 0.5)
    basis = ot.OrthogonalProductPolynomialFactory([ot.LegendreFactory()] * d, enumeration)
    select = ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
    size = min(enumeration.getStrataCumulatedCardinal(5 if d > 10 else 8), 2000)
    algorithm = ot.FunctionalChaosAlgorithm(
        X, y[:, None], distribution, ot.FixedStrategy(basis, size), ot.LeastSquaresStrategy(select)
    )
    algorithm.run()
    model = algorithm.getResult().getMetaModel()
    return lambda points: np.asarray(model(points))[:, 0]


def by_chaospy(X: Array, y: Array) -> Surrogate:
    d, degree = X.shape[1], 1
    law = chaospy.Iid(chaospy.Uniform(-1, 1), d)
    basis = chaospy.generate_expansion(1, law)
    while len(larger := chaospy.generate_expansion(degree + 1, law, cross_truncation=0.5)) <= len(X) / 2:
        degree, basis = degree + 1, larger
    model = chaospy.fit_regression(basis, X.T, y)
    return lambda points: np.asarray(model(*points.T))


def by_gaussian_process(X: Array, y: Array) -> Surrogate:
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    kernel = ConstantKernel(1.0) * RBF(np.ones(X.shape[1]), (0.05, 1e3)) + WhiteKernel(1e-8, (1e-10, 1e-1))
    process = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=2, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(X, y)
    return process.predict


def range_of(surrogate: Surrogate, X: Array) -> tuple[float, float]:
    d = X.shape[1]
    points = np.random.default_rng(0).uniform(-1, 1, (POINTS, d))
    points = np.concatenate([points, np.sign(points[: POINTS // 2]), X])
    y = surrogate(points)
    ends = []
    for sign in (1.0, -1.0):
        best = points[np.argsort(sign * y)[:STARTS]]
        searches = [
            minimize(lambda x: float(sign * surrogate(x[None])[0]), x, method="L-BFGS-B", bounds=[(-1, 1)] * d)  # noqa: B023
            for x in best
        ]
        ends.append(sign * min(search.fun for search in searches))
    return ends[0], ends[1]


def by_search(case: Case, runs: int) -> tuple[float, float]:
    """The range of all values of searches for a minimum and for a maximum in turn."""
    values: list[float] = []

    def f(x: Array, sign: float) -> float:
        if len(values) >= runs:
            raise StopIteration
        values.append(float(case.f(x[None])[0, 0]))
        return sign * values[-1]

    rng, sign = np.random.default_rng(0), 1.0
    try:
        while True:
            minimize(f, rng.uniform(-1, 1, case.d), (sign,), method="L-BFGS-B", bounds=[(-1, 1)] * case.d)
            sign = -sign
    except StopIteration:
        return min(values), max(values)


if __name__ == "__main__":
    warnings.simplefilter("ignore", mb.SymmbWarning)
    makers = {"OpenTURNS": by_openturns, "chaospy": by_chaospy, "GP": by_gaussian_process}
    print(f"{'':28s}{'runs':>6s}" + "".join(f"{name:>18s}" for name in ("symmb", *makers, "search")))
    for name in NAMES:
        case = next(c for c in cases(0) if name in c.name and c.n_t == 1)
        width = float(case.upper[0] - case.lower[0])

        def error(ends: tuple[float, float], case: Case = case, width: float = width) -> float:
            return max(abs(ends[0] - case.lower[0]), abs(ends[1] - case.upper[0])) / width

        begin = time.perf_counter()
        low, high, runs = by_symmb(case)
        cells = [(error((low, high)), time.perf_counter() - begin)]
        X = 2 * qmc.Sobol(case.d, seed=0).random(runs) - 1
        y = case.f(X)[:, 0]
        for make in makers.values():
            begin = time.perf_counter()
            cells.append((error(range_of(make(X, y), X)), time.perf_counter() - begin))
        begin = time.perf_counter()
        cells.append((error(by_search(case, runs)), time.perf_counter() - begin))
        row = "".join(f"{e:10.1e} {seconds:5.1f} s" for e, seconds in cells)
        print(f"{case.name:28s}{runs:6d}{row}", flush=True)
