"""Whether states that are within their absolute tolerances decide on outputs."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np

from symmb._types import Array
from symmb.integrate import Run, Solver, stiffness
from symmb.mechanics import OwnState, VelocityConstraint
from symmb.model import Scene
from symmb.simulation.dae_simulator import DAESimulator
from symmb.simulation.solver_choice import Pilot
from symmb.simulation.trajectory import Trajectory

_INSIDE = 1e3
"""Size of a first-order state over its absolute tolerance up to which its values have few digits."""
_VERY_STIFF = 1e8
"""Decay over a run, in its shortest time constants, of reactions whose slow part may follow from rests that are within
the tolerances: hydraulics and contacts decay by 1e6. tests/simulation/test_small_states.py"""
_FINER, _MANY = 1e-6, 1e3
"""Absolute tolerances of a run that tells what they do, over those of the run; and errors in the unit of the relative
tolerance from which on they are doubted."""
_LEAST = 1e-28
"""Least absolute tolerance."""
_SHARE = 1e-2
"""Share of an output that is off at a time."""
_TIMES = 5
"""Times at which stiffness is estimated."""


class Runs(Protocol):
    """Runs of a scene with parameters p (n_p,) by several solvers."""

    scene: Scene
    simulator: DAESimulator
    p: Array
    done: dict[Solver, tuple[Run, Trajectory]]

    def run(self, solver: Solver) -> Pilot: ...


def small_state_doubts(runs: Runs, solver: Solver, run: Trajectory) -> Iterator[str]:
    """The doubt that outputs change with the absolute tolerances.

    It looks at first-order states, and at velocities that constraints determine: others that are so small are rounding.
    """
    dae, states, elements, p = runs.simulator.bodies.judged, run.examination, runs.scene.system.elements, runs.p
    if not solver.controls_step or not any(isinstance(e, OwnState | VelocityConstraint) for e in elements):
        return
    tolerances = solver.tolerances(dae)
    absolute, names = tolerances.absolute(states.x.shape[1]), [e.name for e in elements if isinstance(e, OwnState)]
    own = dae.n_q + dae.n_v + np.array([k for k, name in enumerate(dae.s_names) if name in names], dtype=np.intp)
    sizes = np.abs(states.x[:, own]).max(axis=0, initial=0.0)
    some = np.unique(np.linspace(0, len(states.t) - 1, _TIMES).astype(int))
    is_small = ((sizes > 0) & (sizes < _INSIDE * absolute[own])).any()
    if not is_small and stiffness(dae, states.x[some], p, states.t[some]).decay * np.ptp(run.t) < _VERY_STIFF:
        return
    atol = max(_FINER * float(absolute.min()), _LEAST)
    if atol >= absolute.min() or runs.run(other := replace(solver, atol=atol)).message:  # pyright: ignore
        return
    finer = runs.done[other][1]
    change, size = np.abs(run.values - finer.values), np.abs(finer.values)
    wrong = (change > _SHARE * size) & (change > _MANY * tolerances.rtol * size.max(axis=0))
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        yield (
            f"Output {run.names[i]!r} depends on states within their absolute tolerances: at t = {run.t[k]:.6g} s "
            f"it is {run.values[k, i]:.3g}, and {finer.values[k, i]:.3g} at smaller ones. Choose "
            f"{type(solver).__name__}(atol=...) far below these states."
        )
