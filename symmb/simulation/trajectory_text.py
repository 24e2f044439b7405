"""The text of a run: its start, its events, its drift, and what is doubtful about it."""

import math
from collections import Counter
from typing import TYPE_CHECKING

from symmb.events import longest_step
from symmb.simulation.dae_simulator import DAESimulator

if TYPE_CHECKING:
    from symmb.simulation.trajectory import Trajectory

_LEAST, _USUAL, _NEAR = 1e-6, 3e3, 1e2
"""Drift of energy that raises a doubt: the least one; in relative tolerances; and the same near singular positions.
Regular motion drifts by up to 1,000 tolerances with multistep methods, wrong branches by 300 and more.
tests/test_problems.py"""
_START = {"held": "held", "solved": "solved for", "free": "left free"}


def unexplained(drift: float, rtol: float | None, usual: float = _USUAL) -> bool:
    """Whether a relative drift is larger than the tolerance explains. Solvers of fixed steps have no tolerance."""
    return rtol is not None and drift > max(_LEAST, usual * rtol)


def trajectory_text(run: "Trajectory", simulator: DAESimulator, rtol: float | None) -> str:
    """The report that `print` shows."""
    start = run.statistics["start"]
    return "\n".join(
        [
            f"{run.name}: {len(run.t)} times from {run.t[0]:g} to {run.t[-1]:g} s by {run.solver}",
            *([f"  solver      chosen: {run.reason}"] if run.reason else []),
            f"  parameters  {', '.join(f'{n} = {v:g}' for n, v in run.parameters.items()) or 'none'}",
            f"  start       {'; '.join(f'{what} {_listed(start[key])}' for key, what in _START.items())}",
            *([f"  redundant   {_listed(start['redundant'])}: least reactions"] if start["redundant"] else []),
            *_pulse_line(longest_step(simulator.dae, run.t), rtol),
            *_event_lines(run),
            *_drift_line(run),
            *([f"  singular    {run.singularity}"] if run.singularity else []),
            *_doubt_line(run, simulator.dae.scales.length, rtol),
            f"  seconds     setup {run.setup_seconds:.3g}, run {run.run_seconds:.3g}",
        ]
    )


def _pulse_line(longest: float, rtol: float | None) -> list[str]:
    if not math.isfinite(longest):
        return []
    passes = "at most {:.2g} s, so that none passes over one"
    if rtol is None:  # the user chose the fixed step
        passes = "more than {:.2g} s may pass over one"
    return [f"  pulses      in laws of time: steps of {passes.format(longest)}"]


def _event_lines(run: "Trajectory") -> list[str]:
    if not run.events:
        return []
    counts = Counter(event.name for event in run.events if event.what == "impact")
    parts = [f"{n} of {name!r}" for name, n in counts.items()]
    parts += [f"{e.name!r} {e.what} at {e.time:.6g} s" for e in run.events if e.what != "impact"]
    work = sum(event.work for event in run.events)
    return [f"  impacts     {', '.join(parts[:6] + ['...'] * (len(parts) > 6))}; work {work:.4g} J"]


def _drift_line(run: "Trajectory") -> list[str]:
    if not run.x.shape[1]:
        return []
    drifts = f"position {run.position_drift:.1e}, velocity {run.velocity_drift:.1e}"
    return [f"  drift       {drifts}, energy {run.energy_drift:.1e}"]


def _doubt_line(run: "Trajectory", length: float, rtol: float | None) -> list[str]:
    """A line on drift above the tolerance. Energy drifts also at singular positions, where branches meet."""
    if unexplained(run.position_drift / length, rtol):
        return ["  doubtful    constraints are left: they contradict each other, or a position is nearly singular"]
    if not unexplained(run.energy_drift, rtol, _NEAR if run.singularity else _USUAL):
        return []
    doubt = f"energy drifts by more than rtol = {rtol:g} explains"
    if run.singularity:
        return [f"  doubtful    {doubt}; another branch may be taken: try stabilization=AugmentedLagrangian()"]
    return [f"  doubtful    {doubt}: try a smaller one"]


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "nothing"
