"""Bounds by several methods, and their errors, run times and coverage."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from symmb._errors import PropagationError, SimulationError
from symmb._interrupts import carry
from symmb._progress import RunProgress
from symmb._types import Array, Executor
from symmb.black_boxes import Simulator, StoredSimulator, noise_from_runs
from symmb.bounds import METHODS, Bounds, Method, checked, doubted, parameter_samples
from symmb.model import Box
from symmb.study.comparison_result import Comparison
from symmb.study.enclosed import Limits
from symmb.study.metrics import Yardstick
from symmb.study.reference import RUNS, Reference, affordable_runs, find_reference, planned_runs
from symmb.study.row import LONG, NotRun, Row

_REPEATS, _ENOUGH = 3, 0.1
"""Least number of runs whose median is the run time. Short runs are repeated until they take this long together [s]."""
_LANES = 8
"""Runs in a vector of the engine."""
_UNCERTAIN = 0.05
"""Uncertainty of the reference, over the width, above which errors are doubtful."""
_WARM_UP = 0.5
"""Time below which the first run does not count [s]. A longer one counts: the median leaves it out."""

_LOG = logging.getLogger("symmb")

Progress = Callable[[str, int, int], None]
"""Called with the label of the work, the runs that are done and all its runs."""


def default_methods(simulator: Simulator, box: Box) -> tuple[Method, ...]:
    """Several settings of each suitable method: points of curves of error against run time."""
    methods = [method for entry in METHODS for method in entry.compared(len(box.names))]
    return tuple(method for method in methods if not method.requires or hasattr(simulator, method.requires))


def compare_simulator(
    simulator: Simulator,
    methods: Sequence[Method] | None,
    box: Box,
    reference: Method | Bounds | None = None,
    *,
    tighter: Simulator | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    **about: Any,
) -> Comparison:
    """Run each method over the box, and score its bounds with the reference's.

    Parameters
    ----------
    methods : sequence of Method, optional      default: `default_methods`
    reference : Method or Bounds, optional      default: see `find_reference`

    Other Parameters
    ----------------
    tighter : Simulator, optional   the same simulator with a ten times tighter tolerance, for the reference and
                                    the error of the solver; without it the reference has the same error
    progress : callable             called with the label of the work, the finished runs and all its runs
    about                           attributes of the Comparison that the caller knows: scene, solver, ...

    Raises
    ------
    PropagationError    if no method can run, or the reference cannot
    KeyboardInterrupt   if it is interrupted: `partial` then holds the Comparison of the methods so far
    """
    repeats = 1 if isinstance(simulator, StoredSimulator) else _REPEATS  # a second time runs would be read, not made
    about = {"scene": "simulator", "solver": "", "threads": 1, "repeats": repeats, **about}
    if methods is None:
        methods = default_methods(simulator, box)
    exact = simulator if tighter is None else tighter
    runs = affordable_runs(_seconds_a_run(exact)) if reference is None else RUNS
    _LOG.info(_announcement(methods, box, reference, runs, repeats))
    reference_bounds = find_reference(
        exact, box, reference, runs=runs, executor=executor, progress=_labelled(progress, "reference")
    )
    scored: list[tuple[Bounds, float]] = []
    doubts: list[tuple[str, ...]] = []
    not_run: list[NotRun] = []
    for number, method in enumerate(methods):
        label = _labelled(progress, repr(method))
        try:
            bounds, seconds = _timed(partial(method.bounds, simulator, box, executor=executor, progress=label), repeats)
        except (PropagationError, SimulationError) as error:
            not_run.append(NotRun(repr(method), str(error).removeprefix(f"{method!r}: ")))
        except KeyboardInterrupt as interrupt:
            if scored:
                not_run += [NotRun(repr(left), "interrupted") for left in methods[number:]]
                carry(interrupt, _comparison(simulator, box, reference_bounds, scored, not_run, doubts, about))
            raise
        else:
            bounds = doubted(simulator, box, bounds)
            doubts.append(checked(method, simulator, box, bounds, executor).doubts)
            scored.append((replace(bounds, surrogate=None), seconds))
    if not scored:
        reasons = " ".join(f"{method.name}: {method.reason}" for method in not_run)
        raise PropagationError(f"None of the methods to compare could run. {reasons}".rstrip())
    difference = _difference(simulator, tighter, box) if tighter is not None else None
    own = reference_bounds = replace(reference_bounds, noise=_noise(simulator, difference))
    if reference is None:
        reference_bounds = reference_bounds.joined([bounds.inner for bounds, _ in scored if bounds.inner is not None])
    limits = Limits.of([bounds for bounds, _ in scored])
    if limits is not None:
        attained = reference is None or reference.kind == "sampled"
        reference_bounds = limits.limit(reference_bounds, attained)
    if difference is not None:
        about["solver_error"] = reference_bounds.yardstick.relative(difference)
    if limits is not None:
        runs_of = [(f"the reference {own.method}", own.lower, own.upper)] if attained else []
        about["doubts"] = tuple(
            limits.faults(
                [bounds for bounds, _ in scored],
                runs_of,
                reference_bounds.yardstick,
                about.get("solver_error"),
                np.asarray(simulator.times, dtype=float),
                tuple(simulator.outputs),
            )
        )
    return _comparison(simulator, box, reference_bounds, scored, not_run, doubts, about)


def _comparison(
    simulator: Simulator,
    box: Box,
    reference: Reference,
    scored: Sequence[tuple[Bounds, float]],
    not_run: Sequence[NotRun],
    found: Sequence[tuple[str, ...]],
    about: Mapping[str, Any],
) -> Comparison:
    """The rows, whose doubts `found` contain what check runs say, and doubts about the rest: it measures errors."""
    setup_seconds = about.get("setup_seconds")
    known = tuple(getattr(simulator, "doubts", ()))
    doubts = *known, *_doubts_of([bounds for bounds, _ in scored], known), *_doubt_of_reference(simulator, reference)
    about = {**about, "doubts": (*doubts, *about.get("doubts", ()))}
    return Comparison(
        times=np.asarray(simulator.times, dtype=float),
        outputs=tuple(simulator.outputs),
        box=box,
        reference=reference,
        rows=tuple(
            _row(bounds, own, reference.yardstick, setup_seconds, seconds)
            for (bounds, seconds), own in zip(scored, found, strict=True)
        ),
        not_run=tuple(not_run),
        **about,
    )


def _doubts_of(scored: Sequence[Bounds], known: Sequence[str]) -> list[str]:
    """The doubts about the bounds, beyond those known, with the methods that they are about. Failed runs are left out,
    as a comparison tells them together."""
    about = dict[str, list[str]]()
    for bounds in scored:
        for doubt in replace(bounds, failed=()).doubts:
            about.setdefault(doubt, []).append(bounds.method)
    return [
        doubt if len(methods) == len(scored) > 1 else f"{' and '.join(methods)}: {doubt}"
        for doubt, methods in about.items()
        if doubt not in known
    ]


def _doubt_of_reference(simulator: Simulator, reference: Reference) -> list[str]:
    """The outputs whose reference is so uncertain that errors of methods cannot be told."""
    uncertain = np.flatnonzero((reference.uncertainty > _UNCERTAIN) & ~reference.yardstick.zero_width)
    if not uncertain.size:
        return []
    names = ", ".join(f"{simulator.outputs[k]} by {reference.uncertainty[k]:.2g}" for k in uncertain)
    return [
        f"The reference {reference.method} is uncertain: {names} of the width. Smaller errors are not known, and "
        "bounds that miss it by less count as covering it. Give another, such as PolynomialChaos(tolerance=1e-3)."
    ]


def _row(
    bounds: Bounds, doubts: tuple[str, ...], yardstick: Yardstick, setup_seconds: float | None, run_seconds: float
) -> Row:
    return Row(
        name=bounds.method,
        kind=bounds.kind,
        evaluations=bounds.evaluations,
        failed=len(bounds.failed),
        setup_seconds=setup_seconds,
        run_seconds=run_seconds,
        lower=bounds.lower,
        upper=bounds.upper,
        estimate=bounds.estimate,
        inner=bounds.inner,
        score=yardstick.score(bounds.lower, bounds.upper, bounds.estimate),
        failure=str(bounds.failed[0]) if bounds.failed else "",
        failed_region=bounds.failed_region,
        caution=bounds.caution,
        doubts=doubts,
    )


def _seconds_a_run(simulator: Simulator) -> float:
    """Time of a run at the nominal parameters, as one of many in lanes and on threads [s]."""
    P = np.array([[*simulator.parameters.values()]])
    if isinstance(simulator, StoredSimulator):
        return simulator.run_seconds(P[0])
    if hasattr(simulator, "prepare"):
        simulator.prepare()  # pyright: ignore[reportAttributeAccessIssue]
    begin = time.perf_counter()
    _ = simulator.run(P).Y
    seconds = time.perf_counter() - begin
    return seconds / (_LANES * simulator.threads) if getattr(simulator, "compiled", False) else seconds  # pyright: ignore[reportAttributeAccessIssue]


def _announcement(
    methods: Sequence[Method], box: Box, reference: Method | Bounds | None, runs: int, repeats: int
) -> str:
    """How many runs a comparison makes, and whether there are fewer because they are slow."""
    d = len(box)
    known = [method.planned_runs(d) for method in methods]
    open_ended = [repr(method) for method, number in zip(methods, known, strict=True) if number is None]
    parts = [f"{sum(filter(None, known))} for the methods"]
    if open_ended:
        parts.append(f"as many as they choose for {', '.join(open_ended)}")
    fewer = ""
    if reference is None:
        parts.insert(0, f"{planned_runs(d, runs)} runs for the reference")
        fewer = f" The reference takes {planned_runs(d)} runs where runs are faster." if runs < RUNS else ""
    elif isinstance(reference, Method):
        parts.insert(0, f"{reference.planned_runs(d) or 'some'} runs for the reference {reference!r}")
    often = f"{_REPEATS} times or more for its run time, and once if it takes {LONG:g} s" if repeats > 1 else "once"
    return f"This comparison makes {', '.join(parts)}.{fewer} Each method runs {often}."


def _timed(run: Callable[[], Bounds], repeats: int = _REPEATS) -> tuple[Bounds, float]:
    """The bounds, and the median duration of warm runs [s]; of the only run if it takes long."""
    bounds, seconds = _once(run)
    if seconds > LONG or repeats == 1:
        return bounds, seconds
    durations = [] if seconds < _WARM_UP else [seconds]
    while len(durations) < repeats or sum(durations) < _ENOUGH:
        durations.append(_once(run)[1])
    return bounds, float(np.median(durations))


def _once(run: Callable[[], Bounds]) -> tuple[Bounds, float]:
    start = time.perf_counter()
    bounds = run()
    return bounds, time.perf_counter() - start


def _difference(simulator: Simulator, tighter: Simulator, box: Box) -> Array:
    """Difference (3, n_t, n_y) of both simulators at the centre and two opposite corners of the box."""
    points = parameter_samples(simulator, box, np.outer([0.0, -1.0, 1.0], np.ones(len(box))))
    return simulator.run(points).Y - tighter.run(points).Y


def _noise(simulator: Simulator, difference: Array | None) -> Array | None:
    """How far runs may be off (n_y,): as far as those of a tighter solver are away, or as a simulator says."""
    if difference is not None:
        return np.nan_to_num(np.abs(difference)).max(axis=(0, 1))
    return noise_from_runs(simulator)


def _labelled(progress: Progress | None, label: str) -> RunProgress | None:
    return None if progress is None else RunProgress(progress, label)
