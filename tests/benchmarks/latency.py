"""How long one waits: for one run, for the paper's expansion, for derivatives, for a build, for a four-bar.

The double pendulum is that of the paper, 10 s, 12 outputs, 1001 times, with an error in the angles of at most 1e-6 rad.
Seconds are the processor's, but those that pass for builds.
"""

# ruff: noqa: E402, I001  (pinned before NumPy starts its threads)
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from _timing import END, median, pin, spent

pin()
import numpy as np
from _casadi import idas, minimal, redundant, runge_kutta
from models import double_pendulum, four_bar

import symmb as mb
from symmb.bound.reductions import bounded
from symmb import DAESimulator
from symmb.run.integrate.solver import Solver

try:
    import chaospy
except ImportError:
    chaospy = None

BUILD = """
import time
from _timing import spent
begin = time.perf_counter()
import symmb as mb
from models.double_pendulum import scene
from symmb.run.simulation.dae_simulator import DAESimulator
imported = time.perf_counter()
pendulum = scene()
declared = time.perf_counter()
before = spent()
DAESimulator(pendulum, mb.DormandPrince())
print(imported - begin, declared - imported, time.perf_counter() - declared, spent() - before)
"""
ERROR = 1e-6
RTOL = 2e-6  # the loosest that keeps to it


def five_parameters() -> mb.Scene:
    """The double pendulum with lengths, masses and gravity as parameters."""
    p = mb.Parameters(l1=1.0, l2=1.0, m1=1.0, m2=1.0, g=9.81)
    ground = mb.Ground()
    rod1 = mb.Body("rod1", mass=p.m1, inertia=p.m1 * p.l1**2 / 12, pose=mb.Planar())
    rod2 = mb.Body("rod2", mass=p.m2, inertia=p.m2 * p.l2**2 / 12, pose=mb.Planar())
    system = mb.System(
        rod1,
        rod2,
        mb.Revolute("shoulder", ground.point(0, 0), rod1.point(0, -p.l1 / 2)),
        mb.Revolute("elbow", rod1.point(0, p.l1 / 2), rod2.point(0, -p.l2 / 2)),
        mb.Gravity(0, p.g),
        parameters=p,
    )
    start = {"rod1.theta": -np.pi / 4, "rod2.theta": -np.pi / 3}
    return mb.Scene(system, start=start, times=np.linspace(0.0, 10.0, 1001), box=mb.Box.around(p, 0.05))


def show(what: str, seconds: float, remark: str = "") -> float:
    print(f"{what:58s}{1e3 * seconds:12.3f} ms   {remark}")
    return seconds


def simulator(scene: mb.Scene, solver: Solver) -> DAESimulator:
    made = DAESimulator(scene, solver)
    made.threads = 1
    return made


def one_run(pendulum: mb.Scene) -> None:
    """One run, against CasADi's."""
    fast = simulator(pendulum, mb.DormandPrince(rtol=RTOL))
    P = np.ones((1, 2))
    error = np.abs(fast.run(P).Y[0, -1, [2, 5]] - END).max()
    first = show("one run", median(lambda: fast.run(P).Y, calls=20), f"rtol {RTOL:g}, error {error:.1e}")
    x0 = fast.start.states(P)[0]
    usual = simulator(pendulum, mb.DormandPrince())
    show("one run, default tolerance", median(lambda: usual.run(P).Y, calls=20), "rtol 1e-08")
    for rtol in (3e-6, 1e-6, 3e-7, 1e-7):
        run = idas(fast.dae, fast.times, rtol)
        error = np.abs(-np.asarray(run(x0[0], P[0]))[[2, 5], -1] - END).max()
        if error <= ERROR:
            break
    seconds = median(lambda: run(x0[0], P[0]))
    show("  casadi idas", seconds, f"rtol {rtol:g}, error {error:.1e}: {seconds / first:.1f} x")
    with tempfile.TemporaryDirectory() as folder:
        turned = np.array([np.pi / 4, np.pi / 3, 0.0, 0.0])[:, None]
        for name, model, start in (("redundant", redundant(fast.dae), x0.T), ("minimal", minimal(), turned)):
            run, built = runge_kutta(*model, 0.01, 1000, 1, Path(folder))
            seconds = median(lambda: run(start, P.T), calls=20)  # noqa: B023
            show(f"  casadi RK4 in C, {name}", seconds, f"gcc {built:.2f} s: {seconds / first:.2f} x")


def chaos(pendulum: mb.Scene) -> None:
    """The paper's expansion of order 2: nine runs, a fit and an inclusion."""
    fast = simulator(pendulum, mb.DormandPrince(rtol=RTOL))
    method = mb.PolynomialChaos.paper(order=2)
    first = show("PolynomialChaos.paper(order=2)", median(lambda: bounded(method, fast, pendulum.box), calls=5))
    grid = np.array(np.meshgrid(*[np.polynomial.legendre.leggauss(3)[0]] * 2)).reshape(2, -1).T
    P = pendulum.box.from_unit(grid)
    show("  of which the 9 runs", median(lambda: fast.run(P).Y, calls=5))
    run, (x0, _) = idas(fast.dae, fast.times, 1e-7), fast.start.states(P)
    runs = median(lambda: [run(x, p) for x, p in zip(x0, P, strict=True)])
    show("  casadi idas, 9 runs", runs, f"rtol 1e-07: {runs / first:.1f} x")
    if chaospy is None:
        print("chaospy cannot be imported: pip install chaospy")
        return
    law = chaospy.Iid(chaospy.Uniform(-1, 1), 2)
    nodes, weights = chaospy.generate_quadrature(2, law, rule="gaussian")
    Y = fast.run(pendulum.box.from_unit(nodes.T)).Y
    basis = chaospy.generate_expansion(2, law)
    fit = median(lambda: chaospy.fit_quadrature(basis, nodes, weights, Y))
    show("  chaospy, fit alone, no bounds", fit, f"{fit / first:.1f} x")


def derivatives(pendulum: mb.Scene) -> None:
    """Second-order Taylor expansions, against CasADi's cvodes on the same equations."""
    method = mb.Taylor(order=2)
    for scene in (pendulum, five_parameters()):
        d = len(scene.box)
        fast, slow = simulator(scene, mb.DormandPrince(rtol=RTOL)), simulator(scene, mb.CVODES(rtol=1e-8))
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            begin = spent()
            bounded(method, fast, scene.box)
            setup = spent() - begin
        first = show(f"Taylor(order=2), {d} parameters", median(lambda: bounded(method, fast, scene.box)))  # noqa: B023
        seconds = median(lambda: bounded(method, slow, scene.box))  # noqa: B023
        show("  first time, with its build", setup)
        show("  casadi cvodes, rtol 1e-8", seconds, f"{seconds / first:.1f} x")


def builds() -> None:
    """A fresh process each time: an empty cache, then a full one."""
    with tempfile.TemporaryDirectory() as folder:
        spent = {"empty cache": [], "cached": []}
        for k in range(10):
            path = Path(folder) / ("cached" if k > 4 else f"{k}")
            path.mkdir(exist_ok=True)
            if k == 5:
                fresh_process(path)
            spent["cached" if k > 4 else "empty cache"].append(fresh_process(path))
    for name, rows in spent.items():
        imports, declare, build, processor = np.median(rows, axis=0)
        remark = (
            f"processor {1e3 * processor:.0f} ms; declaring {1e3 * declare:.0f} ms, importing {1e3 * imports:.0f} ms"
        )
        show(f"declared scene to simulator, {name}", build, remark)


def fresh_process(cache: Path) -> list[float]:
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run([sys.executable, "-c", BUILD], env=environment, capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


def loop() -> None:
    """The four-bar over 10 s: angles at the end to 1e-5 rad, off its constraints by at most 1e-9."""
    scene = four_bar.scene().with_times(np.linspace(0.0, 10.0, 1001))
    names = list(scene.output_names)
    angles = [names.index(n) for n in ("theta_crank", "coupler_angle", "rocker_angle")]
    nominal = np.array([list(scene.system.parameters.values())])
    exact = {s: simulator(scene, s).run(nominal).Y[0, -1, angles]
             for s in (mb.CVODES(rtol=1e-13), mb.DormandPrince(rtol=1e-13))}  # fmt: skip
    end, other = exact.values()
    data = json.loads((Path(__file__).parents[1] / "data" / "four_bar.json").read_text(encoding="utf-8"))
    series = np.array(data["cases"]["grashof"]["values"])[-1, [data["names"].index(names[k]) for k in angles]]
    print(f"four-bar: CVODES(1e-13) is {np.abs(end - other).max():.1e} from DormandPrince(1e-13), "
          f"which is {np.abs(series - other).max():.1e} from tests/data")  # fmt: skip

    def judged(solver: Solver) -> tuple[DAESimulator, float, float]:
        made = simulator(scene, solver)
        error = np.abs(made.run(nominal).Y[0, -1, angles] - other).max()
        return made, error, mb.simulate(scene, solver).position_drift

    first = 0.0
    for kind in (mb.DormandPrince, mb.CVODES, mb.IDAS):
        for rtol in (f * 10.0**-k for k in range(4, 13) for f in (5, 2, 1)):
            made, error, drift = judged(kind(rtol=rtol))
            if error <= 1e-5 and (drift <= 1e-9 or kind is mb.IDAS):
                break
        seconds = median(lambda: made.run(nominal).Y, calls=3)  # noqa: B023
        first = first or seconds
        show(f"four-bar, {made.solver!r}", seconds, f"error {error:.1e}, Phi {drift:.1e}: {seconds / first:.1f} x")


if __name__ == "__main__":
    pendulum = double_pendulum.scene()
    one_run(pendulum)
    chaos(pendulum)
    derivatives(pendulum)
    loop()
    builds()
