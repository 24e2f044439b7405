"""Comparison of methods: their bounds, and their errors, run times and coverage."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, get_args

import numpy as np

from symmb._errors import DeclarationError, PropagationError, SimulationError, warn_of
from symmb._interrupts import carry, kept_interrupts
from symmb._options import require_callable
from symmb._progress import RunProgress, shown
from symmb._types import Array, Executor, Expr
from symmb._units import units_of_parameters
from symmb.bound.answers import Bounds, Kind
from symmb.bound.methods import METHODS, Method, method_of, units_of
from symmb.bound.propagation import doubts_of_checks, doubts_of_runs, with_doubts
from symmb.bound.reductions import bounded, over_parts
from symmb.bound.responses import parameter_samples
from symmb.connect import Simulator, StoredSimulator, noise_from_runs
from symmb.equations.model import Box, Scene
from symmb.run.integrate import Solver
from symmb.run.simulation import Device, SceneSimulator, Subject
from symmb.study.comparison_result import Comparison
from symmb.study.enclosed import ProvedBounds
from symmb.study.metrics import Yardstick
from symmb.study.reference import RUNS, Reference, affordable_runs, find_reference, planned_runs, require_same
from symmb.study.row import LONG_RUN, NotRun, Row

_REPEATS = 3
"""Smallest number of runs for a median run time."""

_LOG = logging.getLogger("symmb")

Progress = Callable[[str, int, int], None]
"""A function that is called with the label of the work, the number of finished runs and the number of all runs."""


@kept_interrupts()
def compare(
    scene_or_simulator: Scene | Simulator,
    methods: Sequence[Method | Bounds | str] | Method | Bounds | str | None = None,
    box: Box | None = None,
    reference: Method | Bounds | str | None = None,
    solver: Solver | str | None = None,
    *,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
    executor: Executor | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    device: Device = None,
) -> Comparison:
    """Bound a scene's outputs by several methods, and measure error and run time of each method.

    Parameters
    ----------
    scene_or_simulator : Scene, FunctionSimulator, ...
    methods : Method or several
        methods, or texts as on the command line, such as "pce:4". Finished `Bounds` of the same outputs, times and box
        are a row as well, such as loaded ones. Default: several settings of each suitable method
    box : Box
        default: the box of the scene
    reference : Method or Bounds
        reference for errors; default: scans at two resolutions, with a ten times smaller tolerance of the solver
    solver : Solver
        solver of all methods, for a Scene; default: chosen by pilot runs
    times, outputs
        used instead of the times and outputs of the scene
    executor : anything with `map`
        runs blocks of samples
    progress : callable
        called with the label of the work, the number of finished runs and the number of all runs; default: a bar, in
        notebooks and terminals
    device : "cuda" for runs on a graphics card of NVIDIA; default: the processor

    Returns
    -------
    Comparison
        the result, which can be printed, plotted and saved

    Raises
    ------
    DeclarationError
        If there is no box, or an argument is not a method, a box or a solver
    PropagationError
        If no method can run, or finished bounds have other outputs, times or intervals
    KeyboardInterrupt
        If the comparison is interrupted. `partial` then contains the Comparison of the finished methods

    Examples
    --------
    >>> import numpy as np, symmb as mb
    >>> t = np.linspace(0.0, 1.0, 3)
    >>> decay = mb.FunctionSimulator(lambda k: np.exp(-k * t), {"k": 1.0}, t, ["x"])
    >>> comparison = mb.compare(decay, [mb.Vertex(), mb.PolynomialChaos.paper(2)], mb.Box(k=(0.9, 1.1)))
    >>> [row.evaluations for row in comparison.rows]
    [2, 3]
    """
    chosen = None if methods is None else _methods(methods)
    if chosen == ():
        raise DeclarationError("compare: methods is empty. Pass at least one method, or leave methods out.")
    require_callable("compare: progress", progress, "label", "done", "all")
    if reference is not None and not isinstance(reference, Bounds):
        reference = method_of("compare: reference", reference)
    with shown(progress, "comparing methods") as progress:
        simulator, box = Subject.of(scene_or_simulator, solver, times, outputs, device).over(box)
        about: dict[str, Any] = {"scene": repr(simulator), "units": units_of(simulator)}
        if isinstance(simulator, SceneSimulator):
            simulator.prepare()
            about |= {
                "tighter": simulator.tighter(),
                "scene": simulator.name,
                "solver": repr(simulator.solver),
                "setup_seconds": simulator.setup_seconds,
                "threads": simulator.threads,
                "reason": simulator.reason,
            }
        return _doubted(
            compare_simulator(simulator, chosen, box, reference, executor=executor, progress=progress, **about)
        )


def _doubted(comparison: Comparison) -> Comparison:
    """The comparison with a warning about failed runs. All warnings of the comparison are issued."""
    counts = {"the reference": comparison.reference.failed or 0} | {row.name: row.failed for row in comparison.rows}
    if failed := ", ".join(f"{count} of {name}" for name, count in counts.items() if count):
        doubt = f"Runs failed: {failed}. The bounds use only the other runs, and may miss the failed cases."
        comparison = replace(comparison, doubts=(*comparison.doubts, doubt))
    warn_of(comparison.doubts, f"Comparison of {comparison.scene}")
    return comparison


def _methods(given: Any) -> tuple[Method | Bounds, ...]:
    try:
        methods = (given,) if isinstance(given, Method | Bounds | type | str) else tuple(given)
    except TypeError:
        methods = (given,)
    return tuple(method if isinstance(method, Bounds) else method_of("compare", method) for method in methods)


def _text(method: Method | Bounds) -> str:
    """The name of a row."""
    return f"{method.method}, given" if isinstance(method, Bounds) else repr(method)


def _require_own(given: Bounds, simulator: Simulator, box: Box) -> None:
    """Raise PropagationError if finished bounds are not those of this simulator and box."""
    what = f"The given result {given.method}"
    require_same(what, given, simulator)
    shape = len(given.t), len(given.names)
    if given.lower.shape != shape or given.upper.shape != shape:
        raise PropagationError(f"{what}: lower and upper must have the shape {shape}.")
    if not (given.lower <= given.upper).all():
        raise PropagationError(f"{what}: lower is above upper, or not a number, at some times.")
    if given.kind not in get_args(Kind) or not str(given.method).isprintable() or not given.method:
        raise PropagationError(f"{what}: kind must be {' or '.join(get_args(Kind))}, and method a text on one line.")
    its_box = given.box and given.box.with_units(units_of_parameters(simulator.parameters))
    own, its = (dict(zip(b.names, b.bounds, strict=True)) if b else {} for b in (box, its_box))
    if its and (own.keys() != its.keys() or not np.allclose([own[k] for k in its], [*its.values()], atol=0.0)):
        raise PropagationError(f"{what} is of {given.box!r}, but the comparison is of {box!r}.")


def default_methods(simulator: Simulator, box: Box) -> tuple[Method, ...]:
    """Several settings of each suitable method, for curves of error against run time."""
    methods = [method for entry in METHODS for method in entry.compared(len(box.names))]
    return tuple(method for method in methods if not method.requires or hasattr(simulator, method.requires))


@dataclass(frozen=True)
class _Measured:
    """A method that ran: its bounds without polynomials, its run time [s], and warnings from check runs.

    Attributes
    ----------
    is_given : whether the bounds were finished before. Their runs, perhaps of another program, do not count as attained
    """

    bounds: Bounds
    seconds: float
    doubts: tuple[str, ...]
    is_given: bool = False

    @property
    def attained(self) -> Bounds:
        """The bounds, with the values that runs of this comparison attained."""
        return replace(self.bounds, inner=None) if self.is_given else self.bounds


def compare_simulator(
    simulator: Simulator,
    methods: Sequence[Method | Bounds] | None,
    box: Box,
    reference: Method | Bounds | None = None,
    *,
    tighter: Simulator | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    **about: Any,
) -> Comparison:
    """Run each method over the box, and compare its bounds with the reference; see `compare`.

    `tighter` is the same simulator with a ten times smaller tolerance. Without `tighter`, the reference contains the
    error of the solver. `about` contains further attributes of the Comparison.
    """
    repeats = 1 if isinstance(simulator, StoredSimulator) else _REPEATS  # repeated runs would only be read again
    about = {"scene": "simulator", "solver": "", "threads": 1, "repeats": repeats, **about}
    if methods is None:
        methods = default_methods(simulator, box)
    for method in methods:
        if isinstance(method, Bounds):
            _require_own(method, simulator, box)
    exact = simulator if tighter is None else tighter
    runs = affordable_runs(_seconds_a_run(exact)) if reference is None else RUNS
    # Python shows messages of this level without any setting: slow runs may take days.
    level = logging.WARNING if runs < RUNS else logging.INFO
    _LOG.log(level, _announcement(methods, box, reference, runs, repeats))
    found = find_reference(
        exact, box, reference, runs=runs, executor=executor, progress=_labelled(progress, "reference")
    )
    ran, not_run = list[_Measured](), list[NotRun]()
    try:
        for method in methods:
            result = _measured(method, simulator, box, repeats, executor, _labelled(progress, _text(method)))
            if isinstance(result, NotRun):
                not_run.append(result)
            else:
                ran.append(result)
    except KeyboardInterrupt as interrupt:
        if ran:
            not_run += [NotRun(_text(left), "interrupted") for left in methods[len(ran) + len(not_run) :]]
            carry(interrupt, _comparison(simulator, box, found, ran, not_run, about))
        raise
    if not ran:
        reasons = " ".join(f"{method.name}: {method.reason}" for method in not_run)
        raise PropagationError(f"No method could run. {reasons}".rstrip())
    if tighter is None:
        difference, noise = None, noise_from_runs(simulator)
    else:  # at the centre and at two opposite corners of the box
        points = parameter_samples(simulator, box, np.outer([0.0, -1.0, 1.0], np.ones(len(box))))
        difference = simulator.run(points).Y - tighter.run(points).Y
        noise = np.nan_to_num(np.abs(difference)).max(axis=(0, 1))
    found = replace(found, noise=noise)
    found, about["solver_error"], about["doubts"] = _confronted(found, reference, [x.attained for x in ran], difference)
    return _comparison(simulator, box, found, ran, not_run, about)


def _measured(
    method: Method | Bounds,
    simulator: Simulator,
    box: Box,
    repeats: int,
    executor: Executor | None,
    progress: RunProgress | None,
) -> _Measured | NotRun:
    if isinstance(method, Bounds):
        return _Measured(replace(method, method=_text(method)), method.seconds, method.doubts, is_given=True)
    try:
        bounds, seconds = _timed(
            partial(bounded, method, simulator, box, executor=executor, progress=progress), repeats
        )
    except (PropagationError, SimulationError) as error:
        return NotRun(repr(method), str(error).removeprefix(f"{method!r}: "))
    bounds = over_parts(bounds, lambda own: with_doubts(own, doubts_of_runs(simulator, own)))
    checked = over_parts(bounds, lambda own: with_doubts(own, doubts_of_checks(method, simulator, own, executor)))
    return _Measured(bounds, seconds, checked.doubts)


def _confronted(
    found: Reference, given: Method | Bounds | None, bounds: Sequence[Bounds], difference: Array | None
) -> tuple[Reference, Array | None, list[str]]:
    """The reference with all attained values, limited by proved bounds; the solver's error; violated proofs."""
    joint = found if given is not None else found.joined([each.inner for each in bounds if each.inner is not None])
    attained = found if given is None or given.kind == "sampled" else None
    proved = ProvedBounds.of(bounds)
    limited = joint if proved is None else proved.limit(joint, attained is not None)
    solver_error = None if difference is None else limited.yardstick.relative(difference)
    faults = [] if proved is None else proved.faults(bounds, attained, limited.yardstick, solver_error)
    is_refuted = proved is not None and attained is not None and proved.is_refuted(attained, joint, solver_error)
    return joint if is_refuted else limited, solver_error, faults


def _comparison(
    simulator: Simulator,
    box: Box,
    reference: Reference,
    ran: Sequence[_Measured],
    not_run: Sequence[NotRun],
    about: Mapping[str, Any],
) -> Comparison:
    """The rows, with warnings from check runs, and warnings about the reference, the solver and the proofs."""
    known = tuple(getattr(simulator, "doubts", ()))
    doubts = *known, *_doubts_of([each.bounds for each in ran], known), *_doubt_of_reference(simulator, reference)
    about = {**about, "doubts": (*doubts, *about.get("doubts", ()))}
    return Comparison(
        times=np.asarray(simulator.times, dtype=float),
        outputs=tuple(simulator.outputs),
        box=box,
        reference=reference,
        rows=tuple(_row(measured, reference.yardstick, about.get("setup_seconds")) for measured in ran),
        not_run=tuple(not_run),
        **about,
    )


def _doubts_of(scored: Sequence[Bounds], known: Sequence[str]) -> list[str]:
    """The new warnings about the bounds, with the methods that they concern."""
    about = dict[str, list[str]]()
    for bounds in scored:
        for doubt in replace(bounds, failed=()).doubts:  # a comparison reports failed runs in one sentence
            about.setdefault(doubt, []).append(bounds.method)
    return [
        doubt if len(methods) == len(scored) > 1 else f"{' and '.join(methods)}: {doubt}"
        for doubt, methods in about.items()
        if doubt not in known
    ]


def _doubt_of_reference(simulator: Simulator, reference: Reference) -> list[str]:
    """A warning that lists the outputs with an uncertain reference."""
    # A warning is issued if the uncertainty of the reference, relative to the width, is larger than this.
    uncertain = np.flatnonzero((reference.uncertainty > 0.05) & ~reference.yardstick.zero_width)
    if not uncertain.size:
        return []
    names = ", ".join(f"{simulator.outputs[k]} by {reference.uncertainty[k]:.2g} of its width" for k in uncertain)
    return [
        f"The reference {reference.method} is uncertain: {names}. Errors of bounds below this "
        "uncertainty are not known, and such bounds count as covering. Pass a more accurate reference, such as "
        "reference=PolynomialChaos(tolerance=1e-3)."
    ]


def _row(measured: _Measured, yardstick: Yardstick, setup_seconds: float | None) -> Row:
    bounds = measured.bounds
    return Row(
        name=bounds.method,
        kind=bounds.kind,
        evaluations=bounds.evaluations,
        failed=len(bounds.failed),
        setup_seconds=setup_seconds,
        run_seconds=measured.seconds,
        lower=bounds.lower,
        upper=bounds.upper,
        estimate=bounds.estimate,
        inner=bounds.inner,
        score=yardstick.score(bounds.lower, bounds.upper, bounds.estimate),
        failure=str(bounds.failed[0]) if bounds.failed else "",
        failed_region=bounds.failed_region,
        caution=bounds.caution,
        doubts=measured.doubts,
    )


def _seconds_a_run(simulator: Simulator) -> float:
    """Duration of a run at the nominal parameters, if many runs use vectors and threads [s]."""
    P = np.array([[*simulator.parameters.values()]])
    if isinstance(simulator, StoredSimulator):
        return simulator.run_seconds(P[0])
    if hasattr(simulator, "prepare"):
        simulator.prepare()  # pyright: ignore[reportAttributeAccessIssue]
    begin = time.perf_counter()
    _ = simulator.run(P).Y
    seconds = time.perf_counter() - begin
    # The engine runs 8 samples in one vector, in each thread.
    return seconds / (8 * simulator.threads) if getattr(simulator, "compiled", False) else seconds  # pyright: ignore[reportAttributeAccessIssue]


def _announcement(
    methods: Sequence[Method | Bounds], box: Box, reference: Method | Bounds | None, runs: int, repeats: int
) -> str:
    """Sentences about the number of runs of a comparison, and about fewer runs of the reference if runs are slow."""
    d = len(box)
    new = [method for method in methods if isinstance(method, Method)]
    known = [method.planned_runs(d) for method in new]
    open_ended = [repr(method) for method, number in zip(new, known, strict=True) if number is None]
    parts = [f"{sum(filter(None, known))} for the methods"]
    if open_ended:
        parts.append(f"and a number of runs that is not known yet for {', '.join(open_ended)}")
    fewer = ""
    if reference is None:
        parts.insert(0, f"{planned_runs(d, runs)} runs for the reference")
        fewer = f" With faster runs, the reference would take {planned_runs(d)} runs." if runs < RUNS else ""
    elif isinstance(reference, Method):
        parts.insert(0, f"{reference.planned_runs(d) or 'some'} runs for the reference {reference!r}")
    often = (
        f"at least {_REPEATS} times to measure its time, or once if it takes {LONG_RUN:g} s" if repeats > 1 else "once"
    )
    return f"This comparison makes {', '.join(parts)}.{fewer} Each method runs {often}."


def _timed(run: Callable[[], Bounds], repeats: int = _REPEATS) -> tuple[Bounds, float]:
    """The bounds, and the median duration [s] of runs after the first; a long run is measured only once."""
    bounds, seconds = _once(run)
    if seconds > LONG_RUN or repeats == 1:
        return bounds, seconds
    # A first run that is shorter than this [s] is not measured. A longer first run is measured: the median excludes it.
    durations = [] if seconds < 0.5 else [seconds]
    while len(durations) < repeats or sum(durations) < 0.1:  # [s]: short runs have noisy durations
        durations.append(_once(run)[1])
    return bounds, float(np.median(durations))


def _once(run: Callable[[], Bounds]) -> tuple[Bounds, float]:
    start = time.perf_counter()
    bounds = run()
    return bounds, time.perf_counter() - start


def _labelled(progress: Progress | None, label: str) -> RunProgress | None:
    return None if progress is None else RunProgress(progress, label)
