"""symmb beside exudyn (generalised-alpha) and CasADi's idas: the time to the same error of positions at the end.

Andrews' mechanism, the four-bar, and 40 windows through a singular position; one core, median of five runs of the
solver alone; errors against symmb's own run at 1e-13, whose digits tests compare with known ones.

    PYTHONPATH=. python tests/benchmarks/peers.py
"""

import numpy as np
from _exudyn_planar import planar
from _timing import median, pin

import symmb as mb
from models import andrews, four_bar, n_four_bar
from symmb.run.integrate.solver import Solver

AUGMENTED = mb.AugmentedLagrangian()


def at_centres(scene: mb.Scene) -> mb.Scene:
    """The scene with positions and angles of the bodies' centres of mass at the end as its outputs."""
    outputs = {}
    for body in scene.system.bodies:
        centre = body.point(*body.com[:2])
        outputs |= {f"{body.name}_x": centre.x, f"{body.name}_y": centre.y, f"{body.name}_angle": body.theta}
    return scene.with_outputs(outputs).with_times([scene.times[0], scene.times[-1]])


def ours(scene: mb.Scene, solver: Solver) -> tuple[np.ndarray, float]:
    """Values at the end, and seconds of a run."""
    simulator = mb.DAESimulator(scene, solver)
    simulator.threads = 1
    P = simulator.dae.p_nominal[None]
    values = simulator.run(P).Y[0, -1]
    return values, median(lambda: simulator.run(P).Y, repeats=5)


def table(name: str, scene: mb.Scene, settings: dict[str, list[tuple[str, Solver]]], counts: list[int]) -> None:
    scene = at_centres(scene)
    true = mb.simulate(scene, settings["reference"][0][1]).values[-1]

    def error(values: np.ndarray) -> float:
        return float(np.abs(values.ravel() - true).max())

    found = {
        family: [
            (label, error(values), seconds) for label, solver in ladder for values, seconds in [ours(scene, solver)]
        ]
        for family, ladder in settings.items()
        if family != "reference"
    }
    run = planar(scene)
    found["exudyn"] = [
        (f"{n} steps", error(run(n)[0]), float(np.median([run(n)[1] for _ in range(5)]))) for n in counts
    ]
    print(f"\n{name}")
    for family, rows in found.items():
        for label, err, seconds in rows:
            print(f"  {family:28}{label:14} error {err:.1e} {1e3 * seconds:9.2f} ms")
    own = [row for family, rows in found.items() if family not in ("exudyn", "CasADi idas") for row in rows]
    for peer in ("exudyn", "CasADi idas"):
        for label, err, seconds in found[peer]:
            enough = [row for row in own if row[1] <= err]
            if not np.isfinite(err):
                print(f"  {peer}, {label}: breaks down")
            elif enough:
                best = min(enough, key=lambda row: row[2])
                print(f"  {peer}, {label}: symmb errs no more in 1/{seconds / best[2]:.1f} of its time ({best[0]})")
            else:
                print(f"  {peer}, {label}: symmb does not reach its error")


def ladders(span: float, stabilization: mb.AugmentedLagrangian | None) -> dict[str, list[tuple[str, Solver]]]:
    explicit = {} if stabilization is None else {"stabilization": stabilization}
    rtols, steps = (1e-4, 1e-6, 1e-8, 1e-10), (100, 300, 1000, 3000, 10000)
    return {
        "reference": [("", mb.DormandPrince(rtol=1e-13, **explicit))],
        "symmb DormandPrince": [(f"rtol {r:g}", mb.DormandPrince(rtol=r, **explicit)) for r in rtols],
        "symmb GeneralizedAlpha": [(f"{n} steps", mb.GeneralizedAlpha(step=span / n)) for n in steps],
        "CasADi idas": [(f"rtol {r:g}", mb.IDAS(rtol=r)) for r in rtols],
    }


def main() -> None:
    pin()
    counts = [300, 1000, 3000, 10000]
    table("Andrews, 0.03 s", andrews.scene(), ladders(0.03, None), counts)
    table("four-bar, 5 s", four_bar.scene(), ladders(5.0, None), counts)
    windows = n_four_bar.scene(40).with_times(np.linspace(0, 1, 2))
    settings = ladders(1.0, AUGMENTED)
    settings["reference"] = [("", mb.DormandPrince(rtol=1e-12, stabilization=AUGMENTED))]
    settings["CasADi idas"] = settings["CasADi idas"][:2]
    table("40 windows, 1 s", windows, settings, counts[:3])


if __name__ == "__main__":
    main()
