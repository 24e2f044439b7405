"""Many parameters and long horizons: runs, errors, estimates, and what fitting and ranges cost apart from the runs.

Chains of rods have a length and a mass each, known to 5 %. Their reference is attained: corners, samples, and the model
itself at all extremes of the finest expansion; over is therefore at most what is shown. The double pendulum's reference
over its last 5 s is a scan of 401 x 401 runs.
"""

import time

import numpy as np
from _suite import boxed, chain

import symmb as mb
from models import double_pendulum
from symmb import DAESimulator
from symmb.bound.reductions import bounded


def rms(a: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(a**2, axis=0))


def attained(simulator: DAESimulator, box: mb.Box, finest: mb.Bounds) -> tuple[np.ndarray, np.ndarray]:
    """Extremes over corners, samples near them, and the expansion's own extremes."""
    d, rng = len(box), np.random.default_rng(0)
    corners = rng.choice([-1.0, 1.0], (4000, d)) if d > 12 else np.indices((2,) * d).reshape(d, -1).T * 2.0 - 1.0
    near = np.where(
        rng.uniform(size=(8000, d)) < 0.8, rng.choice([-1.0, 1.0], (8000, d)), rng.uniform(-1, 1, (8000, d))
    )
    points, expansion = np.concatenate([corners, near]), finest.expansion
    if expansion is not None:  # there is none where the bounds are those of runs
        coefficients = expansion.coefficients.reshape(len(expansion.alpha), -1)
        extremes = mb.Exact(1e-3, budget=20).search(expansion.alpha, coefficients)
        points = np.concatenate([points, extremes.at_lower, extremes.at_upper])
    low, high = simulator.run(box.from_unit(points)).extremes()
    return np.minimum(low, finest.inner[0]), np.maximum(high, finest.inner[1])


def show(name: str, simulator: DAESimulator, box: mb.Box, methods: list[mb.PolynomialChaos], truth=None) -> None:
    """A line for each method; the last one is the finest."""
    results = []
    for method in methods:
        begin = time.perf_counter()
        bounds = bounded(method, simulator, box)
        seconds = time.perf_counter() - begin
        begin = time.perf_counter()
        simulator.run(box.from_unit(np.zeros((bounds.evaluations, len(box))))).Y.sum()
        results.append((bounds, seconds, time.perf_counter() - begin))
    lower, upper = attained(simulator, box, results[-1][0]) if truth is None else truth
    width = rms(upper - lower)
    width = np.where(width > 1e-9, width, np.inf)
    last = slice(None) if truth is None else simulator.times >= simulator.times[-1] - 5.0
    for bounds, seconds, running in results:
        outside = np.maximum(np.maximum(lower - bounds.lower, bounds.upper - upper), 0.0)
        inside = np.maximum(np.maximum(bounds.lower - lower, upper - bounds.upper), 0.0)
        covered = (bounds.estimate + 1e-6 * np.where(np.isfinite(width), width, 1.0) >= np.maximum(outside, inside))[
            last
        ]
        over, under, estimate = (float(np.mean(rms(a[last]) / width)) for a in (outside, inside, bounds.estimate))
        print(f"{name:26s}{bounds.method:38s}{bounds.evaluations:6d}{over:10.1e}{under:10.1e}{estimate:10.1e}"
              f"{covered.mean():9.1%}{running:9.3f}{seconds - running:9.3f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    print(f"{'':26s}{'':38s}{'runs':>6s}{'over':>10s}{'under':>10s}{'estimate':>10s}{'covered':>9s}{'runs [s]':>9s}"
          f"{'rest [s]':>9s}")  # fmt: skip
    for n, end, budgets in ((5, 1.0, (100, 300, 1000, 2000)), (5, 3.0, (1000, 2000)), (10, 1.0, (500, 2000))):
        scene = chain(n, end)
        simulator = DAESimulator(scene, mb.DormandPrince(rtol=1e-9))
        methods = [mb.PolynomialChaos(tolerance=1e-6, budget=budget) for budget in budgets]
        if (n, end) == (5, 1.0):
            methods = [mb.PolynomialChaos(), *methods]
        show(scene.name, simulator, scene.box, methods)
    for end in (30.0, 60.0):
        scene = boxed(double_pendulum.scene().with_times(np.linspace(0, end, int(20 * end) + 1)), 0.05)
        simulator = DAESimulator(scene, mb.DormandPrince(rtol=1e-10))
        scan = bounded(mb.Scanning(401), simulator, scene.box)
        methods = [mb.PolynomialChaos(tolerance=1e-4, budget=budget) for budget in (100, 300, 1200)]
        show(f"double pendulum, {end:g} s", simulator, scene.box, methods, (scan.lower, scan.upper))
