"""Doubts about bounds: one way for studies and for comparisons of methods."""

import time
from dataclasses import replace

import numpy as np

from symmb._doubt import Doubt
from symmb._names import counted
from symmb._types import Array, Executor
from symmb._units import with_units
from symmb.bound.bounds.check_runs import check_doubts, some_corners
from symmb.bound.bounds.method import Method, parameter_samples
from symmb.bound.bounds.reductions import gathered
from symmb.bound.bounds.result import Bounds
from symmb.bound.bounds.time_windows import ROUNDING, ROUNDING_SCALE
from symmb.bound.nodes import Sobol, corners
from symmb.connect import Noisy, SecondLook, Simulator
from symmb.equations.model import Box, unused_parameters
from symmb.run.simulation import DAESimulator, SceneSimulator, motion_of


def doubted(simulator: Simulator, box: Box, bounds: Bounds) -> Bounds:
    """The bounds that a method gives, with the doubts about its runs in ``run_doubts``."""
    unused, far = _unused_doubts(simulator, box), _far_nominal_values(simulator, box)
    bounds = replace(bounds, run_doubts=(*bounds.run_doubts, *unused), remarks=(*bounds.remarks, *far))
    if bounds.kind == "enclosure":
        if not isinstance(simulator, DAESimulator):
            return bounds
        # Errors of the solver are none of proofs, which make no runs.
        doubts = (*simulator.start.doubts, *_nominal_doubts(simulator))
        doubts = (*doubts, *_linear_theory_doubts(simulator, box, bounds.seconds))
        return replace(bounds, run_doubts=(*bounds.run_doubts, *doubts))
    own, remarks = _second_look(simulator, box, bounds)
    own = (*own, *_linear_theory_doubts(simulator, box, bounds.seconds))
    doubts = (*own, *_pulse_doubts(simulator, box), *_noise_doubts(simulator, bounds))
    remarks += _without_effect(simulator, box, bounds)
    return replace(bounds, run_doubts=(*bounds.run_doubts, *doubts), remarks=(*bounds.remarks, *remarks))


def checked(method: Method, simulator: Simulator, box: Box, bounds: Bounds, executor: Executor | None = None) -> Bounds:
    """The bounds with what check runs say against them in ``run_doubts``, where the method does not estimate its error.

    ``evaluations`` leaves these runs out; a remark tells their number.
    """
    doubts, n = check_doubts(simulator, box, bounds, method.doubtful_miss, executor)
    text = f"{counted(n, 'further run')} checked these bounds. The number of evaluations does not include them."
    remarks = (*bounds.remarks, text) if n else bounds.remarks
    return replace(bounds, run_doubts=(*bounds.run_doubts, *doubts), remarks=remarks)


def _unused_doubts(simulator: Simulator, box: Box) -> tuple[str, ...]:
    """Parameters with intervals on which nothing of a scene depends: mostly their nominal values were taken."""
    if not isinstance(simulator, SceneSimulator) or simulator.scene is None:  # as in a copy from a pickle
        return ()
    varied = [name for name, low, high in zip(box.names, box.lower, box.upper, strict=True) if low < high]
    return tuple(
        f"{name} is in the box, but nothing in the scene depends on it. "
        f'p["{name}"] is a number; p.{name} is the symbol.'
        for name in unused_parameters(simulator.scene, varied)
    )


def _far_nominal_values(simulator: Simulator, box: Box) -> list[str]:
    """Remarks on nominal values far from their interval, mostly because its unit is another one."""
    remarks = []
    for name, (low, high) in zip(box.names, box.bounds, strict=True):
        value = float(simulator.parameters[name])
        if max(low - value, value - high) > high - low > 0:
            (told,) = with_units({name: f"{value:.6g}"}, simulator.parameters)
            remarks.append(f"The nominal value {told} is far outside of its interval from {low:.6g} to {high:.6g}.")
    return remarks


def _without_effect(simulator: Simulator, box: Box, bounds: Bounds) -> list[str]:
    """Which parameters change no output of a black box, by its polynomials, and by pairs of runs that differ in one.

    Equations of scenes tell it by themselves. Most parameters act, so that mostly no runs are made.
    """
    surrogate, varies = bounds.surrogate, box.radius > 0
    if surrogate is None or isinstance(simulator, SceneSimulator):
        return []
    floor = ROUNDING_SCALE * np.abs([bounds.lower, bounds.upper]).max(axis=(0, 1), initial=0.0)
    small = np.maximum(floor, _IDLE_SHARE * (bounds.upper - bounds.lower).max(axis=0))
    idle = np.flatnonzero(~surrogate.acting(small) & varies)
    if not len(idle):
        return []
    base = Sobol().points(_EQUAL_PAIRS, len(box), seed=2)
    pairs = np.concatenate([base, *(np.where(np.arange(len(box)) == i, np.roll(base, 1, axis=0), base) for i in idle)])
    Y, _ = gathered(simulator, parameter_samples(simulator, box, pairs), None)
    first, *others = Y.reshape(len(idle) + 1, _EQUAL_PAIRS, *Y.shape[1:])
    names = [box.names[i] for i, own in zip(idle, others, strict=True) if (np.abs(own - first) <= floor).all()]
    if not names:
        return []
    verb = "changes" if len(names) == 1 else "change"
    return [f"{', '.join(names)} {verb} no output, in all runs of the study and {counted(len(Y), 'further run')}."]


def _second_look(simulator: Simulator, box: Box, bounds: Bounds) -> tuple[tuple[str, ...], list[str]]:
    """Doubts and remarks from the run at the nominal parameters and one at a corner, which are made in two ways.

    That at the corner is left out if the first one has doubts, or took longer than the study and a second.
    """
    if isinstance(simulator, SecondLook):
        simulator.second_look()
    own, motion = tuple(getattr(simulator, "doubts", ())), motion_of(simulator)
    beside = motion is simulator  # widths of figures are not those of their curves
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
    if first.seconds > bounds.seconds + _SECONDS_BEYOND_STUDY:
        left_out = f"No run at a corner was checked by a second method, because one run takes {first.seconds:.0f} s."
        return own, [*remarks, left_out]
    signs = np.where(np.arange(len(box)) % 2 == 0, 1.0, -1.0)  # unequal ends: equal ones may keep a symmetry
    p = parameter_samples(simulator, box, signs[None])[0]
    corner = motion.ways.two(p)
    doubts = corner.doubts or (_doubts_of_widths(motion, p, widths) if beside else ())
    return (*own, *doubts), [*remarks, *filter(None, [corner.unchecked])]


def _doubts_of_widths(simulator: DAESimulator, p: Array, widths: Array) -> tuple[str, ...]:
    """Whether errors of a run are large beside the widths (n_y,) of bounds, by the more accurate of two other ways."""
    if not simulator.ways.two(p).is_large_beside(widths):
        return ()
    return simulator.ways.two(p, finest=True).doubts_of_widths(widths)


def _linear_theory_doubts(simulator: Simulator, box: Box, seconds: float) -> tuple[str, ...]:
    """What runs at corners of the box ask of flexible bodies, where the nominal one asks nothing of the kind.

    No further run begins when they have taken as long as the study and a second.
    """
    motion = motion_of(simulator)
    if motion is None or motion.ways.flexible is None or _nominal_doubts(motion):
        return ()
    end = time.perf_counter() + seconds + _SECONDS_BEYOND_STUDY
    d = len(box)
    unit = corners(d) if d <= _PARAMETERS_OF_ALL_CORNERS else np.repeat([[-1.0], [1.0]], d, axis=1)
    for p in parameter_samples(simulator, box, unit):
        where = ", ".join(f"{name} = {value:g}" for name, value in zip(simulator.parameters, p, strict=True))
        if time.perf_counter() > end:
            break
        if doubts := motion.ways.theory_doubts(p):
            return tuple(f"At {where}: {doubt}" for doubt in doubts)
    return ()


def _nominal_doubts(simulator: DAESimulator) -> tuple[str, ...]:
    """What the run at the nominal parameters asks of flexible bodies."""
    return simulator.ways.theory_doubts(simulator.dae.p_nominal)


def _pulse_doubts(simulator: Simulator, box: Box) -> tuple[str, ...]:
    """Whether laws of time have pulses at corners of the box that are shorter than those which steps follow."""
    motion = motion_of(simulator)
    if motion is None:
        return ()
    corners_of_box = parameter_samples(simulator, box, some_corners(len(box), np.random.default_rng(0)))
    P = np.vstack([motion.dae.p_nominal, corners_of_box])
    usual, *others = motion.formulation.pulses(motion.times)(P).tolist()
    k = int(np.argmin(others))
    if others[k] > min(usual / 2, _LONG_PULSE * float(np.ptp(motion.times))):
        return ()
    where = ", ".join(f"{name} = {value:g}" for name, value in zip(simulator.parameters, P[k + 1], strict=True))
    return (
        f"At {where} a function of time has a pulse that is shorter than the steps of the solver, which may miss it. "
        "Take nominal parameters at which the pulse is shortest.",
    )


def _noise_doubts(simulator: Simulator, bounds: Bounds) -> tuple[str, ...]:
    """Outputs that vary by less than their noise, but by more than rounding. The noise of scenes is a rough guess."""
    if isinstance(simulator, SceneSimulator) or not isinstance(simulator, Noisy) or simulator.noise is None:
        return ()
    lower, upper = bounds.inner or (bounds.lower, bounds.upper)
    varies = (upper - lower > ROUNDING * np.maximum(np.abs(lower), np.abs(upper))).any(axis=0)
    below = (upper <= lower + simulator.noise).all(axis=0) & varies
    names = [bounds.names[k] for k in np.flatnonzero(below)]
    text = f"The noise of the runs is larger than the width of {', '.join(names)}, so that the width is not known."
    return (Doubt(text, names),) if names else ()


_SECONDS_BEYOND_STUDY = 1.0
"""Time beyond that of a study which a second look may take [s]."""
_LONG_PULSE = 1e-2
"""Share of the horizon above which steps meet a pulse anyway."""
_IDLE_SHARE = 1e-4
"""Share of the width up to which polynomials, which may smooth, can stand for no effect."""
_EQUAL_PAIRS = 4
"""Pairs of runs, all over the box, that must be equal where a parameter has no effect."""
_PARAMETERS_OF_ALL_CORNERS = 3
"""Parameters up to which runs at all corners are asked about flexible bodies; of more, at the two extreme ones."""
