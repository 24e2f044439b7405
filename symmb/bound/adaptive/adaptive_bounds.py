"""Polynomial chaos that chooses its own runs: the number of runs, and the kind of grid."""

from dataclasses import replace

import numpy as np

from symmb._doubt import Doubt
from symmb._errors import PropagationError
from symmb._magnitudes import LAST_DIGITS, SAME, SLIGHT
from symmb._types import Array, Executor, Indices, Mask
from symmb.bound.adaptive.check_points import SAFETY
from symmb.bound.adaptive.clock import Clock
from symmb.bound.adaptive.runs import UNKNOWN_SHARE, OutgrownError, Runs, relative_errors
from symmb.bound.adaptive.small_study import Problem
from symmb.bound.adaptive.studies import decided
from symmb.bound.adaptive.surrogate import EstimatedRange, Evidence
from symmb.bound.answers import Bounds
from symmb.bound.polynomials import Expansion
from symmb.bound.polynomials.ranges import MOST_PARAMETERS
from symmb.bound.responses import DOUBTFUL, USED_UP, Trace, failed_region, rms, tolerance_remark
from symmb.connect import Progress, Simulator
from symmb.equations.model import Box

MOST_RUNS, MOST_NUMBERS = 5000, 40_000_000
"""The largest number of runs without a budget, and the largest number of stored values. The values take 0.3 GB, and
their coefficients the same."""
NOISY_SHARE = 0.2
"""Bounds are uncertain if the measured noise is larger than this part of the width. The bounds of a few runs that show
only noise are five times as wide as the noise."""


def adaptive_bounds(
    text: str,
    tolerance: float,
    budget: int | None,
    seconds: float | None,
    probes: int,
    simulator: Simulator,
    box: Box,
    executor: Executor | None,
    progress: Progress | None,
) -> Bounds:
    """Bounds by interpolants that are refined until their estimated error is below ``tolerance`` of the width.

    The error of an output is a root mean square over time, divided by the root mean square of the width. The largest
    error of all outputs is compared with the tolerance. Errors are at least the distance of runs beyond the
    interpolant's range. If the error exceeds the width of the extremes of runs, or if an output is only noise, these
    extremes are the bounds.
    """
    d, numbers = int((box.radius > 0).sum()), max(len(simulator.times) * len(simulator.outputs), 1)
    first = probes + (max(5, 3**d) if d <= MOST_PARAMETERS else 2 * d + 1)
    most = max(min(MOST_RUNS, MOST_NUMBERS // numbers), 2 * first) if budget is None else budget
    if first > most:
        takes = "and the probes take" if probes else "takes"
        raise PropagationError(f"{text}: the first level {takes} {first} runs, more than the budget of {most}.")
    runs = Runs(simulator, box, most, executor, progress, Clock(seconds), probes)
    while True:
        try:
            estimated = decided(problem := Problem(runs, tolerance, is_patient=budget is not None))
            break
        except OutgrownError:
            runs = runs.anew()
        if first > runs.left:
            raise PropagationError(
                f"{text}: later runs give values 1e90 times as large, and too few runs are left to start "
                "again. Use the logarithm of the output as the output, or a larger budget."
            )
    is_noise, power = np.isinf(runs.rms_widths()), runs.power
    lower, upper, evidence = _attained_or_estimated(runs, estimated, is_noise, problem.waves)
    estimate = evidence.error
    errors = relative_errors(estimate, runs.rms_widths())
    runs.tell("all", evidence.decisive(int(np.argmax(errors))), errors)
    remarks, doubts = _of_accuracy(runs, tolerance, estimate)
    lower, upper, estimate = (_scaled(each, power) for each in (lower, upper, estimate))
    scalar = [simulator.outputs.index(name) for name in getattr(simulator, "figures", ())]
    for each in (lower, upper, estimate):  # ranges of equal polynomials differ by rounding
        each[:, scalar] = each[:1, scalar]
    bounds = Bounds(
        t=simulator.times,
        names=simulator.outputs,
        lower=lower,
        upper=upper,
        kind="estimate",
        method=text,
        evaluations=len(runs),
        estimate=estimate,
        noise=_scaled(runs.floor, power),
        inner=(_scaled(runs.extremes[0], power), _scaled(runs.extremes[1], power)),
        failed=runs.failed,
        failed_region=failed_region(runs.box, runs.tried, ~runs.ok),
        run_doubts=(*doubts, *_of_noise(runs)),
        remarks=(*remarks, *_of_rounding(runs, is_noise)),
        range_of=estimated.surrogate,
        trace=Trace(tuple(runs.rounds.steps), evidence.rule),
    )
    found = estimated.polynomials and estimated.polynomials()
    if found is None:
        return bounds
    if scalar:  # bounds from runs at corners may contain values that polynomials through other runs do not have
        points = np.concatenate([runs.places[runs.is_attained], runs.points])
        Y = np.concatenate([runs.nodes[runs.is_attained][:, :1, scalar], runs.checks[:, :1, scalar]])
        off = np.abs(found.part([0], scalar).values(points) - Y).max(axis=0) - runs.noise[scalar]
        error = found.error.copy()
        error[:, scalar] = np.maximum(error[:, scalar], off)
        found = replace(found, error=error)
    del runs  # frees memory: the polynomials need as much as the runs

    def in_units(own: Expansion) -> Expansion:
        own = own.without(np.zeros(d, dtype=bool), is_noise)
        return replace(own, coefficients=_scaled(own.coefficients, power)) if power.any() else own

    found = found.changed(in_units, np.maximum(_scaled(found.error, power), estimate))
    found = found if box.radius.all() else found.beside_fixed(box.names, box.radius > 0)
    return replace(bounds, surrogate=found, expansion=found.expansions[0] if len(found.expansions) == 1 else None)


def _attained_or_estimated(
    runs: Runs, estimated: EstimatedRange, is_noise: Mask, waves: list[int]
) -> tuple[Array, Array, Evidence]:
    """Bounds (n_t, n_y), and the evidence of their errors.

    If the error exceeds the width of the extremes of runs, the bounds are these extremes. This does not apply to
    outputs with `waves`, because all runs may be at the same phase.
    """
    lowest, highest = runs.extremes
    evidence = estimated.evidence.at_least("beyond", runs.beyond(estimated.lower, estimated.upper))
    below = above = is_lost = np.zeros(lowest.shape, dtype=bool)
    if estimated.places is not None:
        below, above = near_lost = runs.is_near_lost(estimated.places)
        is_lost = below | above
        predicted = np.stack([lowest - estimated.lower, estimated.upper - highest])
        unknown = evidence.error + np.maximum(predicted, UNKNOWN_SHARE * (highest - lowest))
        evidence = evidence.at_least("failed runs", np.where(near_lost, unknown, 0.0).max(axis=0))
    floor = np.where(highest > lowest, np.where(is_noise, runs.floor, runs.noise), 0.0)
    evidence = evidence.replaced(is_noise, Evidence.of("noise", np.zeros(floor.shape))).at_least("noise", floor)
    # Errors at check runs are multiplied by a safety factor, and noise alone causes such errors.
    evidence = evidence.attributed((evidence.error <= SAFETY * runs.noise) & runs.noise_is_known, "noise")
    evidence = evidence.attributed(highest == lowest, "exact")
    unresolved = is_noise | (evidence.error > highest - lowest)
    unresolved[:, waves] = is_noise[waves]
    # Such polynomials are far off. Their errors do not say how far the extremes of runs are off.
    evidence = evidence.limited(np.where(unresolved & ~is_lost, (highest - lowest).max(axis=0), np.inf))
    lower = np.where(unresolved | below, lowest, np.minimum(estimated.lower, lowest))
    upper = np.where(unresolved | above, highest, np.maximum(estimated.upper, highest))
    return lower, upper, evidence


def _of_accuracy(runs: Runs, tolerance: float, estimate: Array) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Remarks and warnings if the estimated error (n_t, n_y) of an output exceeds the tolerance."""
    errors = rms(estimate) / runs.rms_widths()
    if not (short := tolerance_remark(runs.simulator.outputs, tolerance, errors)):
        return (), ()
    if runs.clock.is_cut or runs.lack or not runs.left:
        short = f"{short} {USED_UP}"
    if not runs.clock.is_cut:
        return (short,), ()
    # The estimated error shows the effect on each output.
    cut = Doubt(_CUT.format(tolerance=tolerance, allowed=runs.clock.allowed))
    return ((short,), (cut,)) if errors.max() > DOUBTFUL else ((short, cut), ())


def _of_noise(runs: Runs) -> tuple[str, ...]:
    """A warning about outputs with large measured noise. Outputs that are only rounding errors are ignored."""
    low, high = runs.extremes
    scale = np.maximum(rms(low), rms(high))
    is_large = runs.noise > np.maximum(NOISY_SHARE * rms(high - low), SLIGHT * scale)
    is_large &= scale > SAME * scale.max(initial=0.0)
    if not is_large.any() or runs.rounding < SAME:  # the simulator states its noise
        return ()
    text = f"The measured noise of runs is above a fifth of the width of {_listed(runs, is_large)}."
    return (Doubt(text, np.array(runs.simulator.outputs)[is_large].tolist()),)


def _listed(runs: Runs, which: Mask, most: int = 4) -> str:
    """The first names of the outputs that a mask (n_y,) selects, as text."""
    names = [name for name, is_one in zip(runs.simulator.outputs, which, strict=True) if is_one]
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")


def _of_rounding(runs: Runs, is_noise: Mask) -> tuple[str, ...]:
    """A remark about outputs whose small variation counts as rounding, although rounding errors are smaller."""
    lowest, highest = runs.extremes
    if runs.rounding < SAME:  # the simulator states its noise
        return ()
    widths, sizes = highest - lowest, np.maximum(np.abs(lowest), np.abs(highest))
    listed = _listed(runs, is_noise & (widths > 16 * LAST_DIGITS * sizes).any(axis=0))
    if not listed:
        return ()
    return (
        f"{listed}: the width is below 1e-9 of the values, and counts as rounding. If runs are more accurate, state "
        "their error with FunctionSimulator(..., noise=...).",
    )


_CUT = (
    "The study ended before it reached the tolerance {tolerance:g}, because computations other than runs would take "
    "longer than {allowed}. Allow more time by PolynomialChaos(seconds=...)."
)
"""The warning if a study had no time to refine the bounds, and its error is far above the tolerance."""


def _scaled(values: Array, power: Indices) -> Array:
    """Values (..., n_y) times 2^power. Values above the largest double become infinite."""
    with np.errstate(over="ignore"):
        return np.ldexp(values, power) if power.any() else values
