"""How instructions, compiler seconds and run time grow with a chain of n rods and n four-bar windows.

    scaling.py picture.png [most rods, 200]

A run is a block of as many samples as the processor has lanes, from rest at the default tolerance over 2 / n s for
chains, whose fastest motion is as fast as n, and 0.2 s for windows. The peer is CasADi's cvodes at the same tolerance
on the same equations, one sample, and gcc on the C that CasADi writes of the rates. Chains in space have no peer. All
seconds are the processor's.
"""

# ruff: noqa: E402, I001  (pinned before NumPy starts its threads)
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from _timing import median, pin, spent

pin()
import casadi as ca
import numpy as np
from models import chain, n_four_bar

import symmb as mb
from symmb.run.codegen.build import has_compiler
from symmb import DAESimulator

AXES = ((0, 0, 1), (1, 0, 0), (0, 1, 0))
COLUMNS = (
    "statements a link",
    "ready from cache [s]",
    "compiler [s]",
    "run [us a link]",
    "gcc of casadi [s]",
    "cvodes [us a link]",
)


def chain_in_space(n: int) -> mb.Scene:
    """A chain of n rods on hinges about z, x and y in turn, from the ground, bent by 0.05 rad each."""
    p = mb.Parameters(length=1.0, mass=1.0)
    L, m = p.length / n, p.mass / n
    elements: list = [mb.Gravity(0, 0, -9.81)]
    at, joints = mb.Ground().point(0, 0, 0), []
    for k in range(n):
        rod = mb.Body(f"rod{k}", m, (m * L**2 / 12, m * L**2 / 100, m * L**2 / 12), mb.Spatial())
        joints.append(mb.Revolute(f"joint{k}", at, rod.point(0, -L / 2, 0), axis=AXES[k % 3]))
        elements += [rod, joints[-1]]
        at = rod.point(0, L / 2, 0)
    start, outputs = (
        {f"{joint.name}.angle": 0.05 for joint in joints},
        {"first": joints[0].angle, "last": joints[-1].angle},
    )
    return mb.Scene(mb.System(*elements, parameters=p), start, [0.0, 1.0], outputs)


def measure(scene: mb.Scene, links: int, horizon: float, has_peer: bool) -> list[float]:
    """One row of the table."""
    scene = scene.with_times(np.linspace(0.0, horizon, 21))
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        begin = spent()
        simulator = DAESimulator(scene, mb.DormandPrince())
        simulator.prepare()
        first = spent()
        DAESimulator(scene, mb.DormandPrince()).prepare()
        again = spent()
        generated = casadi_compiler(simulator.dae.rhs, Path(folder)) if has_peer else math.nan
    rates = re.findall(r"void rates_\d+\(.*?\n}", simulator.program.engine().source, re.DOTALL)
    statements = sum(text.count("const V v") for text in rates)
    simulator.threads = 1
    N = simulator.program.engine().width
    P = np.tile(list(simulator.parameters.values()), (N, 1))
    run = median(lambda: simulator.run(P).Y) / N
    cvodes = cvodes_seconds(scene, P[:1]) if has_peer else math.nan
    derive = again - first
    return [statements / links, derive, first - begin - derive, 1e6 * run / links, generated, 1e6 * cvodes / links]


def cvodes_seconds(scene: mb.Scene, P: np.ndarray) -> float:
    """Seconds of a run by CasADi's cvodes at the engine's tolerance."""
    peer = DAESimulator(scene, mb.CVODES(rtol=1e-8))
    peer.threads = 1
    return median(lambda: peer.run(P).Y)


def casadi_compiler(f: ca.Function, folder: Path) -> float:
    """Seconds that gcc takes for CasADi's C of a Function, at the engine's level of optimisation."""
    generator = ca.CodeGenerator("f.c")
    generator.add(f)
    generator.generate(f"{folder}/")
    begin = spent()
    subprocess.run(
        ["gcc", "-O2", "-march=native", "-shared", "-fPIC", folder / "f.c", "-o", folder / "f.so"], check=True
    )
    return spent() - begin


def table(
    name: str,
    make: Callable[[int], mb.Scene],
    sizes: list[int],
    links: Callable[[int], int],
    horizon: Callable[[int], float],
    has_peer: bool = True,
) -> np.ndarray:
    """Rows (n, ...) printed as they come."""
    print(f"\n{name}\n{'n':>5s}" + "".join(f"{column:>20s}" for column in COLUMNS))
    rows = []
    for n in sizes:
        rows.append([n, *measure(make(n), links(n), horizon(n), has_peer)])
        print(f"{n:5d}" + "".join(f"{value:20.3f}" for value in rows[-1][1:]), flush=True)
    return np.array(rows)


def picture(tables: dict[str, np.ndarray], path: str) -> None:
    """Every column over n, on logarithmic axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 7), layout="constrained")
    for k, (axes, column) in enumerate(zip(figure.subplots(2, 3).ravel(), COLUMNS, strict=True), 1):
        for name, rows in tables.items():
            axes.loglog(rows[:, 0], rows[:, k], "o-", label=name)
        axes.set(xlabel="n", title=column)
        axes.grid(which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    has_compiler()
    most = int(sys.argv[2]) if len(sys.argv) > 2 else 200
    chains = [n for n in (10, 20, 50, 100, 200) if n <= most]
    windows = [n for n in (2, 5, 10, 20, 40) if n <= most]
    spatial = [n for n in (10, 30, 100, 300) if n <= most]
    tables = {
        "chain(n)": table("chain of n rods", chain.scene, chains, lambda n: n, lambda n: 2 / n),
        "n_four_bar(n)": table("n four-bar windows", n_four_bar.scene, windows, lambda n: 2 * n + 1, lambda n: 0.2),
        "in space": table("chain of n rods in space", chain_in_space, spatial, lambda n: n, lambda n: 2 / n, False),
    }
    picture(tables, sys.argv[1])
