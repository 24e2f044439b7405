"""Whether states that are within their absolute tolerances decide on outputs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from symmb._types import Array
from symmb.integrate import Solver, stiffness
from symmb.mechanics import OwnState, VelocityConstraint
from symmb.simulation.dae_simulator import DAESimulator
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


def small_state_doubts(
    simulator: DAESimulator,
    solver: Solver,
    run: Trajectory,
    p: Array,
    elements: Sequence[object],
    again: Callable[[Solver], Trajectory | None],
) -> Iterator[str]:
    """The doubt that outputs change with the absolute tolerances; `again` makes a run by another solver.

    It looks at first-order states, and at velocities that constraints determine: others that are so small are rounding.
    """
    dae, states = simulator.dae, run.examination
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
    finer = again(replace(solver, atol=atol)) if atol < absolute.min() else None  # pyright: ignore
    if finer is None:
        return
    change, size = np.abs(run.values - finer.values), np.abs(finer.values)
    wrong = (change > _SHARE * size) & (change > _MANY * tolerances.rtol * size.max(axis=0))
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        yield (
            f"Output {run.names[i]!r} depends on states within their absolute tolerances: at t = {run.t[k]:.6g} s "
            f"it is {run.values[k, i]:.3g}, and {finer.values[k, i]:.3g} at smaller ones. Choose "
            f"{type(solver).__name__}(atol=...) far below these states."
        )
