"""The settings of solvers that a stability study tries, from fast to slow."""

from collections.abc import Sequence

from symmb.equations.model import Scene
from symmb.run.formulations import program_of
from symmb.run.integrate import (
    CVODES,
    NSTIFFSI2,
    SOLVERS,
    DormandPrince,
    GeneralizedAlpha,
    Rosenbrock,
    Solver,
    StabilizedIndex2,
    stiffness,
)

CONTROLLED = frozenset({"DormandPrince", "Rosenbrock", "StabilizedIndex2", "CVODES, stiff", "CVODES"})
"""Families of solvers with tolerances, used for a reference or for harder variants."""
FIXED = frozenset(entry.family for entry in SOLVERS if entry.ladder is not None and not entry.tolerances)
"""Families with fixed steps."""

FILTERING = frozenset({"GeneralizedAlpha", "NSTIFFSI2"})
"""Families with fixed steps that damp fast oscillations. They are a reference if no solver with tolerances finishes."""

Ladder = Sequence[tuple[float, Solver]]
"""Pairs of a relative tolerance or a step [s], and a solver."""


def references(step: float) -> dict[str, Ladder]:
    """Very different solvers with two tolerances or steps each, by family."""
    return {
        "DormandPrince": [(r, DormandPrince(rtol=r)) for r in (1e-9, 1e-12)],
        "Rosenbrock": [(r, Rosenbrock(rtol=r)) for r in (1e-6, 1e-8)],
        "CVODES, stiff": [(r, CVODES(rtol=r, stiff=True)) for r in (1e-9, 1e-11)],
        "GeneralizedAlpha": [(h, GeneralizedAlpha(step=h)) for h in (step / 16, step / 64)],
        "NSTIFFSI2": [(h, NSTIFFSI2(step=h)) for h in (step / 16, step / 64)],
    }


def ladders(horizon: float, rate: float) -> dict[str, Ladder]:
    """All solvers, by family. Fixed steps depend on the horizon [s] and the rate of the fastest motion [rad/s, 1/s]."""
    families: dict[str, Ladder] = {}
    fixed = [50, 200, 800, 3200]
    fixed += finer_numbers(fixed[-1], horizon * rate)
    for entry in SOLVERS:
        if entry.ladder is not None:
            numbers = (1e-4, 1e-6, 1e-8) if entry.tolerances else fixed  # tolerances: coarse, usual and fine
            settings = numbers if entry.tolerances else [horizon / n for n in numbers]
            families[entry.family] = [(s, entry.ladder(n, horizon)) for s, n in zip(settings, numbers, strict=True)]
    return families


def under_stress(step: float) -> dict[str, Ladder]:
    """Some very different solvers, by family. Two settings of a solver allow a comparison of its runs."""
    return {
        "DormandPrince": [(r, DormandPrince(rtol=r)) for r in (1e-6, 1e-8, 1e-10, 1e-12)],
        "GeneralizedAlpha": [(h, GeneralizedAlpha(step=h)) for h in (step / 4, step / 16, step / 64)],
        "NSTIFFSI2": [(h, NSTIFFSI2(step=h)) for h in (step, step / 16, step / 64)],
        "Rosenbrock": [(r, Rosenbrock(rtol=r)) for r in (1e-5, 1e-7, 1e-9)],
        "CVODES, stiff": [(r, CVODES(rtol=r, stiff=True)) for r in (1e-8, 1e-10)],
        "StabilizedIndex2": [(r, StabilizedIndex2(rtol=r)) for r in (1e-6, 1e-8)],
        "CVODES": [(r, CVODES(rtol=r)) for r in (1e-9, 1e-12)],
    }


def finer_numbers(most: float, radians: float) -> list[int]:
    """Numbers of fixed steps that resolve a fastest motion of `radians` [rad], without numbers near or below `most`."""
    # Explicit methods are stable with half a step for each radian, and accurate with more steps. 200,000 steps take a
    # tenth of a second or more, and RungeKutta needs some seconds to compile them.
    return [round(n * radians) for n in (0.5, 2.0, 8.0, 32.0) if 1.5 * most < n * radians <= 200_000]


def finer_steps(scene: Scene, longest: float) -> Ladder:
    """Steps that resolve the fastest motion of a scene at its start, if they are shorter than `longest` [s]."""
    horizon = float(scene.times[-1] - scene.times[0])
    numbers = finer_numbers(horizon / longest, horizon * start_rate(scene))
    return [(horizon / n, NSTIFFSI2(step=horizon / n)) for n in numbers]


def start_rate(scene: Scene) -> float:
    """Rate of the fastest motion of the equations linearised at the start [rad/s, 1/s]."""
    program = program_of(scene)
    dae, p = program.bodies.dae, program.bodies.dae.p_nominal
    states, _ = program.bodies.start.states(p[None])
    return stiffness(dae, states, p, program.times[:1]).rate
