"""What cannot be trusted about a run: drift, positions that are not reached, pulses."""

from symmb._types import Array

_LEAST, _USUAL, _NEAR = 1e-6, 3e3, 1e2
"""Drift of energy that raises a doubt: the least one; in relative tolerances; and the same near singular positions.
Regular motion drifts by up to 1,000 tolerances with multistep methods, wrong branches by 300 and more.
tests/test_problems.py"""
_OF_STEPS = 0.01
"""Drift of energy by fixed steps that is visible in the motion."""
_UNREACHED = 1e-2
"""Violation of positions, over the size of the scene, that no solver leaves where positions can be reached."""


def unexplained(drift: float, rtol: float | None, usual: float = _USUAL) -> bool:
    """Whether a relative drift is larger than the tolerance explains. Solvers of fixed steps have no tolerance."""
    return rtol is not None and drift > max(_LEAST, usual * rtol)


def drift_doubts(
    position: float, energy: float, is_singular: bool, rtol: float | None, is_driven: bool
) -> tuple[str, ...]:
    """What drifts above the tolerance suggest. Energy drifts also at singular positions, where branches meet.

    A drive may ask for velocities that jump: fixed steps keep them, and do not see their work.
    """
    if unexplained(position, rtol):
        return (
            f"The run leaves its constraints by {position:.0e} of its size: they contradict each other, or a position "
            "is nearly singular.",
        )
    if rtol is None and energy > _OF_STEPS and not is_driven:
        return (
            f"The energy drifts by {energy:.0%}: the steps are too long, or they damp the motion. Take shorter ones.",
        )
    if not unexplained(energy, rtol, _NEAR if is_singular else _USUAL):
        return ()
    drift = f"The energy drifts by {energy:.0e}, which is more than rtol = {rtol:g} explains."
    if is_singular:
        return (f"{drift} The run may have taken another branch: try stabilization=AugmentedLagrangian().",)
    return (f"{drift} Try a smaller one.",)


def unreached(t: Array, violation: Array, rtol: float | None) -> str:
    """When and why a run leaves its constraints, as relative violations (n_t,) tell; empty if it does not."""
    left = ~(violation <= _UNREACHED)
    if not left.any():
        return ""
    k = int(left.argmax())
    cause = "drives contradict each other, jump within a step, or ask for positions that cannot be reached"
    return (
        f"the run leaves its constraints at t = {t[k]:g} s, by up to {violation.max():.0e} of its size: "
        f"{'steps are too long, ' if rtol is None else ''}{cause}"
    )


def pulse_doubts(longest: float, step: float) -> tuple[str, ...]:
    """Whether fixed steps, 0 where steps are controlled, are longer than those that pass over no pulse [s]."""
    if step <= longest:
        return ()
    return (f"Steps of {step:.2g} s may pass over a pulse in a law of time: take less than {longest:.2g} s.",)
