"""Warnings about bounds, for studies and for comparisons of methods."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from symmb._doubt import Doubt
from symmb._magnitudes import ROUNDING, SAME
from symmb._names import counted
from symmb._types import Array, Executor
from symmb._units import typeset, units_of_parameters, values_text, with_units
from symmb.bound.answers import Bounds
from symmb.bound.methods import Method
from symmb.bound.nodes import Sobol, corners
from symmb.bound.propagation.check_runs import check_doubts, some_corners
from symmb.bound.responses import gathered, parameter_samples
from symmb.connect import Noisy, SecondLook, Simulator, is_recorded
from symmb.equations.model import Box, unused_parameters
from symmb.run.simulation import DAESimulator, RandomSimulator, SceneSimulator, motion_of

Told = tuple[Sequence[str], Sequence[str]]
"""Warnings about bounds, and remarks."""


def with_doubts(bounds: Bounds, *told: Told, **known: Any) -> Bounds:
    """The bounds with further warnings, remarks and attributes."""
    doubts = [doubt for doubts, _ in told for doubt in doubts]
    remarks = [remark for _, remarks in told for remark in remarks]
    known |= {"run_doubts": (*bounds.run_doubts, *doubts), "remarks": (*bounds.remarks, *remarks)}
    return replace(bounds, **known)


def doubts_of_runs(simulator: Simulator, bounds: Bounds) -> Told:
    """Warnings and remarks about the runs of a method."""
    box = bounds.box
    assert box is not None
    doubts = (*far_intervals(simulator, box), *_unused_doubts(simulator, box))
    remarks = _outside_nominal_values(simulator, box)
    if bounds.kind != "enclosure":
        own, more = _second_look(simulator, box, bounds)
        own = (*own, *_linear_theory_doubts(simulator, box, bounds))
        doubts = (*doubts, *own, *_pulse_doubts(simulator, box), *_noise_doubts(simulator, bounds))
        sampling = [simulator.remark] if isinstance(simulator, RandomSimulator) else []
        remarks = [*remarks, *more, *_without_effect(simulator, box, bounds), *filter(None, sampling)]
    elif isinstance(simulator, DAESimulator):
        # A proof makes no runs, so errors of the solver do not concern it.
        doubts = (*doubts, *simulator.start.doubts, *_nominal_doubts(simulator))
        doubts = (*doubts, *_linear_theory_doubts(simulator, box, bounds))
    return doubts, remarks


def doubts_of_checks(method: Method, simulator: Simulator, bounds: Bounds, executor: Executor | None = None) -> Told:
    """Warnings from check runs, if the method does not estimate its error, and a remark with the number of these runs.

    ``evaluations`` does not count the check runs.
    """
    doubts, n = check_doubts(simulator, bounds, method.doubtful_miss, executor)
    text = f"{counted(n, 'further run')} checked these bounds. The number of evaluations does not include them."
    return doubts, [text] if n else []


def _unused_doubts(simulator: Simulator, box: Box) -> tuple[str, ...]:
    """Warnings about parameters of the box that do not occur in the scene. Often the scene contains numbers instead."""
    if not isinstance(simulator, SceneSimulator) or simulator.scene is None:  # e.g. a copy from a pickle
        return ()
    varied = [name for name, low, high in zip(box.names, box.lower, box.upper, strict=True) if low < high]
    return tuple(
        f"{name} is in the box, but nothing in the scene depends on {name}. "
        f'Use the symbol p.{name}; p["{name}"] is a number.'
        for name in unused_parameters(simulator.scene, varied)
    )


def far_intervals(simulator: Simulator, box: Box) -> Iterator[str]:
    """Warnings about intervals that differ from the nominal value by a factor of 100, often because of a wrong unit."""
    units = units_of_parameters(simulator.parameters)
    if is_recorded(simulator):  # nominal values are means of the runs
        return
    for name, (low, high) in zip(box.names, box.bounds, strict=True):
        value = float(simulator.parameters.get(name, low))  # unknown names are told later
        small, large = sorted([abs(value), max(abs(low), abs(high))])
        if max(low - value, value - high) > high - low and 0 < small < 0.01 * large:
            unit = f" {typeset(units.get(name, ''))}".rstrip()
            yield (
                f"The interval of {name} from {low:g} to {high:g}{unit} is far from the nominal value "
                f"{value:g}{unit}. Check its unit."
            )


def _outside_nominal_values(simulator: Simulator, box: Box) -> list[str]:
    """Remarks on nominal values outside of their interval."""
    remarks = []
    for name, (low, high) in zip(box.names, box.bounds, strict=True):
        value = float(simulator.parameters[name])
        if low < high and max(low - value, value - high) > SAME * max(abs(low), abs(high)):
            (told,) = with_units({name: f"{value:.6g}"}, simulator.parameters)
            remarks.append(f"The nominal value {told} is outside of the interval from {low:.6g} to {high:.6g}.")
    return remarks


def _without_effect(simulator: Simulator, box: Box, bounds: Bounds) -> list[str]:
    """A remark on parameters that change no output of a black box.

    Scenes need no runs for this remark, because their equations show which parameters have an effect.
    """
    if isinstance(simulator, SceneSimulator) or is_recorded(simulator):
        return []
    names, runs = idle_parameters(simulator, box, bounds, range(len(bounds.names)))
    if not names:
        return []
    verb = "changes" if len(names) == 1 else "change"
    return [f"{', '.join(names)} {verb} no output in the runs of the study and in {counted(runs, 'further run')}."]


def idle_parameters(
    simulator: Simulator, box: Box, bounds: Bounds, columns: Sequence[int], executor: Executor | None = None
) -> tuple[list[str], int]:
    """Names of parameters that do not change some outputs, given by their indices, and the number of further runs.

    Polynomials show parameters that seem to have no effect. Pairs of runs that differ in one parameter then confirm
    that there is no effect.
    """
    if bounds.surrogate is None:
        return [], 0
    ends = np.stack([bounds.lower, bounds.upper])[..., columns]
    floor = ROUNDING * bounds.scale[[*columns]]
    # A parameter may have no effect if its effect in polynomials, relative to the width, is below 1e-4.
    width = (ends[1] - ends[0]).max(axis=0)
    small = np.where(np.isfinite(width), np.maximum(floor, 1e-4 * width), floor)
    idle = np.flatnonzero(~bounds.surrogate.part(slice(None), columns).acting(small) & (box.radius > 0))
    if not len(idle):
        return [], 0
    base = Sobol().points(_EQUAL_PAIRS, len(box), seed=2)
    pairs = np.concatenate([base, *(np.where(np.arange(len(box)) == i, np.roll(base, 1, axis=0), base) for i in idle)])
    Y, _ = gathered(simulator, parameter_samples(simulator, box, pairs), executor)
    first, *others = Y[..., columns].reshape(len(idle) + 1, _EQUAL_PAIRS, len(Y[0]), -1)
    names = [box.names[i] for i, own in zip(idle, others, strict=True) if (np.abs(own - first) <= floor).all()]
    return names, len(Y)


def _second_look(simulator: Simulator, box: Box, bounds: Bounds) -> tuple[tuple[str, ...], list[str]]:
    """Warnings and remarks from the nominal run and a run at a corner. Both runs are repeated by a second method.

    There is no run at a corner if the nominal run has warnings, or took much longer than the study.
    """
    if isinstance(simulator, SecondLook):
        simulator.second_look()
    own, motion = tuple(getattr(simulator, "doubts", ())), motion_of(simulator)
    beside = motion is simulator  # a scalar output and its curve have different widths
    if motion is None:
        return own, []
    first = motion.ways.two(motion.dae.p_nominal)
    remarks = [first.unchecked] if first.unchecked else []
    if first.doubts:
        return own, remarks
    lower, upper = bounds.inner or (bounds.lower, bounds.upper)
    widths = (upper - lower).max(axis=0)
    if beside and (beside_widths := _doubts_of_widths(motion, motion.dae.p_nominal, widths)):
        return (*own, *beside_widths), remarks
    if not motion.ways.most(motion.dae.p_nominal, _OPERATIONS, bounds.evaluations):
        return own, [*remarks, "No run at a corner was checked by a second method, because such a run takes too long."]
    signs = np.where(np.arange(len(box)) % 2 == 0, 1.0, -1.0)  # unequal ends, because equal ones may keep a symmetry
    p = parameter_samples(simulator, box, signs[None])[0]
    corner = motion.ways.two(p)
    doubts = corner.doubts or (_doubts_of_widths(motion, p, widths) if beside else ())
    return (*own, *doubts), [*remarks, *filter(None, [corner.unchecked])]


def _doubts_of_widths(simulator: DAESimulator, p: Array, widths: Array) -> tuple[str, ...]:
    """Warnings if errors of a run are large compared with the widths (n_y,) of bounds.

    The more accurate of two other methods confirms a large error.
    """
    if not simulator.ways.two(p).is_large_beside(widths):
        return ()
    return simulator.ways.two(p, finest=True).doubts_of_widths(widths)


def _linear_theory_doubts(simulator: Simulator, box: Box, bounds: Bounds) -> tuple[str, ...]:
    """Warnings that flexible bodies deform too much for linear theory at corners of the box.

    If the nominal run has this warning, corners are not checked. Fewer corners are checked if runs take long.
    """
    motion = motion_of(simulator)
    if motion is None or motion.ways.flexible is None or _nominal_doubts(motion):
        return ()
    d, most = len(box), motion.ways.most(motion.dae.p_nominal, _OPERATIONS, bounds.evaluations)
    # Largest number of parameters for checks of flexible bodies at all corners. Above it, two corners are checked.
    unit = corners(d) if d <= 3 else np.repeat([[-1.0], [1.0]], d, axis=1)
    for p in parameter_samples(simulator, box, unit[:most]):
        where = values_text(simulator.parameters, p, units_of_parameters(simulator.parameters))
        if doubts := motion.ways.theory_doubts(p):
            return tuple(f"At {where}: {doubt}" for doubt in doubts)
    return ()


def _nominal_doubts(simulator: DAESimulator) -> tuple[str, ...]:
    """Warnings that flexible bodies deform too much for linear theory in the nominal run."""
    return simulator.ways.theory_doubts(simulator.dae.p_nominal)


def _pulse_doubts(simulator: Simulator, box: Box) -> tuple[str, ...]:
    """A warning if a function of time has a pulse at a corner of the box that is shorter than the solver's steps."""
    motion = motion_of(simulator)
    if motion is None or not motion.formulation.pulses(motion.times).are_possible:
        return ()
    corners_of_box = parameter_samples(simulator, box, some_corners(len(box), np.random.default_rng(0)))
    P = np.vstack([motion.dae.p_nominal, corners_of_box])
    usual, *others = motion.formulation.pulses(motion.times)(P).tolist()
    k = int(np.argmin(others))
    # The solver does not miss pulses that are longer than this fraction of the horizon.
    if others[k] > min(usual / 2, 1e-2 * float(np.ptp(motion.times))):
        return ()
    where = values_text(simulator.parameters, P[k + 1], units_of_parameters(simulator.parameters))
    return (
        f"At {where} a function of time has a pulse that is shorter than the steps of the solver. The solver may miss "
        "the pulse. Use nominal parameters with the shortest pulse.",
    )


def _noise_doubts(simulator: Simulator, bounds: Bounds) -> tuple[str, ...]:
    """A warning about outputs with a width between rounding and noise, except for scenes: their noise is estimated."""
    if isinstance(simulator, SceneSimulator) or not isinstance(simulator, Noisy) or simulator.noise is None:
        return ()
    lower, upper = bounds.inner or (bounds.lower, bounds.upper)
    varies = (upper - lower > SAME * np.maximum(np.abs(lower), np.abs(upper))).any(axis=0)
    below = (upper <= lower + simulator.noise).all(axis=0) & varies
    names = [bounds.names[k] for k in np.flatnonzero(below)]
    text = f"The noise of the runs is larger than the width of {', '.join(names)}. The true width is not known."
    return (Doubt(text, names),) if names else ()


_OPERATIONS = 1e9
"""Number of operations that checks by a second method may take in addition to those of the study: about a second."""
_EQUAL_PAIRS = 4
"""Number of pairs of runs, spread over the box, that must be equal if a parameter has no effect."""
