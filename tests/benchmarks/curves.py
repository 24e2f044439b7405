"""Error against run time of all methods: the double pendulum at four spreads, a scene in space, six parameters.

    curves.py picture.png [seconds]

Errors are means over outputs; references are expansions of high order. Lines join the settings of one method. The
seconds are added to the time of each run, as if runs cost so much more: 200e-6, say.
"""

import sys

from _suite import boxed, chain
from matplotlib.figure import Figure

import symmb as mb
from models import double_pendulum, spherical_pendulum
from symmb.bound.bounds.method import Method

CHEBYSHEV = {"nodes": mb.ChebyshevGauss(), "range": mb.ChebyshevInclusion()}


def families(d: int) -> dict[str, list[Method]]:
    """Methods by the name in the legend; those that would take too many runs in d parameters are left out."""
    grids = [k for k in (3, 6, 11, 21, 41) if k**d <= 2000]
    orders = [p for p in (2, 3, 4, 5, 6) if (p + 1) ** d <= 2000]
    parts = [k for k in (1, 2, 4) if k**d <= 64]
    return {
        "PolynomialChaos()": [mb.PolynomialChaos(tolerance=t, budget=2000) for t in (0.1, 3e-2, 1e-2, 3e-3, 1e-3)],
        "paper": [mb.PolynomialChaos.paper(p) for p in orders],
        "Chebyshev inclusion": [mb.PolynomialChaos(order=p, **CHEBYSHEV) for p in orders],
        "Taylor": [mb.Taylor(order) for order in (1, 2, 3)],
        "Taylor, subintervals": [mb.Taylor(2, subintervals=k) for k in parts],
        "vertex": [mb.Vertex()],
        "scanning": [mb.Scanning(k) for k in grids],
        "Monte Carlo": [mb.MonteCarlo(n) for n in (100, 1000, 10_000, 100_000)],
        "optimisation": [mb.Optimization(budget=n) for n in (100, 300)],
    }


def scenes() -> list[tuple[str, mb.Scene, Method]]:
    """Title, scene, reference."""
    found = []
    for spread, order in ((0.05, 32), (0.1, 32), (0.15, 64), (0.2, 64)):
        scene = boxed(double_pendulum.scene(), spread)
        found.append((f"double pendulum ± {spread:.0%}", scene, mb.PolynomialChaos(order=order)))
    found.append(("spherical pendulum ± 5 %, in space", spherical_pendulum.scene(), mb.PolynomialChaos(order=32)))
    found.append(("3 rods, 6 parameters ± 5 %, 1 s", chain(3, 1.0), mb.PolynomialChaos(tolerance=1e-6, budget=3000)))
    return found


if __name__ == "__main__":
    added = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    figure = Figure(figsize=(14, 8.5), layout="constrained")
    for axes, (title, scene, reference) in zip(figure.subplots(2, 3).ravel(), scenes(), strict=True):
        by_name = families(len(scene.box))
        methods = [method for family in by_name.values() for method in family]
        rows = {row.name: row for row in mb.compare(scene, methods, reference=reference).rows}
        print(title)
        for name, family in by_name.items():
            known = [rows[repr(m)] for m in family if repr(m) in rows]
            points = [(row.run_seconds + added * row.evaluations, row.score.error.mean()) for row in known]
            axes.loglog(*zip(*points, strict=True), "o-", label=name, linewidth=2.5 if "Chaos" in name else 1.2)
            print(f"  {name:22s}" + "  ".join(f"{1e3 * s:8.2f} ms {e:.1e}" for s, e in points), flush=True)
        axes.set(title=title, xlabel="run time [s]", ylabel="error [share of the width]")
        axes.grid(which="both", alpha=0.25)
    figure.axes[0].legend(fontsize=8)
    figure.savefig(sys.argv[1], dpi=90)
