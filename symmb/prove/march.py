"""The march over the horizon: proved steps, passes of switches, changes of states, and the control of step sizes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from symmb._magnitudes import FACTORS, ROUNDING, SLIGHT, SMALL
from symmb._types import Array
from symmb.prove import chebyshev as ch
from symmb.prove.clock import bounds_by_clock
from symmb.prove.ellipses import Choice, Control
from symmb.prove.errors import NO_BOUND, ProofError
from symmb.prove.flow import Curve, frame, integrated, motion
from symmb.prove.front import Front, in_frame, leaving, well_conditioned
from symmb.prove.outputs import OutputBounds, output_bounds
from symmb.prove.pass_outputs import Part, bounds_about_pass
from symmb.prove.passes import Crossing, Scaled, crossing, departure, pass_errors, window
from symmb.prove.problem import Change, Problem
from symmb.prove.rounding import above, grain_of
from symmb.prove.start import constant_step, drifted, first_front, mapped, require_known
from symmb.prove.step import Proof, is_regular, on_motion, prove, require_valid
from symmb.prove.stiff import decaying, is_stiff, jacobian
from symmb.prove.time_step import TimeStep

_TIME_TERMS = 20
"""Number of terms of the motion in time. With the step length of `_shortened`, the last terms are rounding errors."""
_SHORTER_STEP = 0.3
"""Factor that shortens a step in which the motion changes too fast."""
_PATIENCE_AT_END = 5.0
"""Increase of the patience over the horizon, relative to that at the begin."""
_SMALL_REMAINDER = 0.1
"""Remainder relative to the width of the states, up to which the patience increases."""
_UNITS_BEFORE_CHANGE = 8
"""Shortest step before a change of states, in units of times. A change within this time is made at once."""


@dataclass(frozen=True, eq=False)
class Place:
    """A front with the control of the next step and the problem of the current phase."""

    front: Front
    control: Control
    problem: Problem


@dataclass(eq=False)
class Course:
    """The proved results over a part of the box.

    Attributes
    ----------
    bounds : bounds of the outputs, infinite if they are not known
    until : time after the first one up to which the motion is proved [s]
    why : reason for the end of the proof; empty if it can continue
    end : the last place; None before the start
    checkpoint : the last place with a small remainder, or the first place
    stored : number of output times with stored bounds
    steps : proved steps with bounds (n,) of |w|; None if they are not needed
    """

    bounds: OutputBounds
    until: float = 0.0
    why: str = ""
    end: Place | None = None
    checkpoint: Place | None = None
    stored: int = 0
    steps: list[tuple[TimeStep, Array]] | None = None

    @classmethod
    def empty(cls, problem: Problem) -> "Course":
        """A course before the start. With a clock, bounds at a time follow from several steps."""
        bounds = OutputBounds.unknown(len(problem.times), problem.outputs.numel_out(0))
        return cls(bounds, steps=None if problem.clock is None else [])

    @property
    def is_done(self) -> bool:
        """Whether the proof has reached all output times."""
        return self.stored == len(self.bounds.lower)

    def store(self, behind: int, bounds: OutputBounds) -> None:
        """Store bounds of the outputs for the output times from `stored` to `behind` (excluded)."""
        self.bounds.put(slice(self.stored, behind), bounds)
        self.stored = behind

    def back_to(self, place: Place, times: Array) -> "Course":
        """The course up to a place, from which it can continue. `times` (n_t,) are the output times."""
        until = place.problem.reached(place.front.t)
        stored = min(self.stored, int(np.searchsorted(times, until, side="right")))
        bounds = OutputBounds.unknown(len(times), len(self.bounds.terms))
        bounds.put(slice(stored), self.bounds.at(slice(stored)))
        steps = None if self.steps is None else [own for own in self.steps if own[0].t0 < place.front.t]
        return Course(bounds, until, "", place, place, stored, steps)


def march(
    problem: Problem, order: int, course: Course, small: float, patience: float, progress: Callable[[float], None]
) -> None:
    """Continue a course over one box from its last place, or from the start.

    Parameters
    ----------
    order : highest degree in each parameter
    small : a place is a checkpoint if its remainder, relative to the width of the states, is smaller than this
    patience : the march stops after this number of attempts at steps beyond those that pay; later it has more patience
    progress : called with the reached time [s]
    """
    end = float(problem.times[-1])
    if course.end is None:
        try:
            front = first_front(problem, order)
            problem = _settled(problem, front)
        except ProofError as error:
            course.why = f"the start cannot be proved, because {error}"
            return
        # a start that is the same in the whole box has no motion, and a remainder of rounding errors
        is_rough = front.share() > SMALL and (front.reach > SLIGHT * problem.scales).any()
        # the first step that is tried is 1/50 of the horizon; a step that is too long is shortened
        control = Control(Choice(), (end or 1.0) / 50, lost=np.inf if is_rough else 0.0)
        course.end = course.checkpoint = Place(front, control, problem)
    place, longest = course.end, 0.0
    while not (course.is_done or place.control.lost > patience * _more_patience(place, course.until / (end or 1.0))):
        try:
            place, h = _next_place(course, place, grain_of(end))
        except ProofError as error:
            course.why = _why(place, str(error))
            return
        course.end, course.until = place, place.problem.reached(place.front.t)
        progress(course.until)
        share, longest = place.front.share(), max(longest, h)
        if share <= small:
            course.checkpoint = place
        # without this limit, many short steps would follow
        if share > 1e-2 and place.control.h < longest / 64:
            course.why = _why(place, "small deviations from the computed motion grow too fast")
            return


def _more_patience(place: Place, reached: float) -> float:
    """A factor of the patience at a fraction of the horizon.

    Halves take about as many steps as the whole. With small remainders, a halving pays only if more attempts are lost.
    """
    return 1.0 + _PATIENCE_AT_END * reached if place.front.share() < _SMALL_REMAINDER else 1.0


def _why(place: Place, reason: str) -> str:
    """The reason for the end of a proof at a place, with a possible cause soon after this time.

    The cause may be a determinant of the loops that would soon be 0, or a switch. A proof ends before a switch only if
    slopes grow without bound there.
    """
    problem, front, phase = place.problem, place.front, place.problem.phase
    if problem.regular is not None and problem.closing and problem.why_singular not in reason:
        h, x, p = place.control.h, front.middle, problem.middle
        ahead = x + h * problem.rates(x, p, front.t).full().ravel()
        now, then = (problem.regular(*at).full().ravel() for at in ((x, p, front.t), (ahead, p, front.t + h)))
        # steps become short before a singular position, so it may still be 40 steps away
        is_near = (now - then) * np.sign(now) * 40 > np.abs(now)
        reason = f"{reason}; {problem.why_singular}" if is_near.any() else reason
    is_explained = NO_BOUND not in reason and phase is not None and any(f"'{own}'" in reason for own in phase.labels)
    if phase is not None and problem.valid_tape is not None and not is_explained:
        sides = on_motion(constant_step(problem, front.t, front.x), problem.valid_tape, np.zeros(problem.n), (1, 1))
        # a kink with infinite slopes ends a proof at a distance of some widths of the box
        near = [k for k, a in enumerate(sides) if not (np.real(a.centre) > 3.0 * a.swing).all()]
        reason = f"{reason}; {phase.steep(near[0])}" if near else reason
    return reason


def _next_place(course: Course, place: Place, grain: float) -> tuple[Place, float]:
    """The place after a proved step or pass, and its length in time [s]. The course stores bounds of the outputs."""
    problem, front, control = place.problem, place.front, replace(place.control)
    usual, left = control.h, _left(problem, front.t, grain)
    control.h, others = min(usual, left), tuple[Problem, ...]()
    try:
        step, proof = _step(problem, front, grain, control)
    except _AheadError as found:
        control.h = usual
        if front.t == 0.0 and found.ahead.first <= grain:
            assert problem.phase is not None
            try:
                first, problem, others = departure(problem, front, found.ahead.which, usual)
            except ProofError as error:
                raise ProofError(problem.phase.sentence(found.ahead.which[0], front.t, str(error))) from error
            control.h = min(usual, left)
            step, proof = _step(first, front, grain, control)
        else:
            try:
                passed = _passed(course, replace(place, control=control), found.ahead, grain)
            except ProofError as error:
                step, proof = _nearer(replace(place, control=control), found.ahead, grain, str(error))
            else:
                return _changed(passed, grain, course.is_done), passed.front.t - front.t
    if course.steps is not None:
        course.steps.append((step, proof.W) if problem.clock is None else step.with_remainder(proof.W))
    front, times = leaving(step, proof.end), problem.times
    late = _late(problem, front.t)
    # outputs at times within four errors of an instant have the values after the instant
    until = front.t if late is None else front.t - 4 * late
    behind = int(np.searchsorted(times, problem.reached(until), side="right"))
    if behind > course.stored:
        own = times[course.stored : behind]
        if problem.clock is None:
            course.store(behind, output_bounds(step, proof.W, own, control))
        else:
            assert course.steps is not None
            course.store(behind, bounds_by_clock(course.steps, own, control))
    for other in others:  # an output on a switch may have the value of either side
        own = output_bounds(replace(step, problem=other), proof.W, times[:1], control)
        course.bounds.put(slice(1), course.bounds.at(slice(1)).joined(own))
    if left < usual:
        control.h, control.lost = usual, place.control.lost
    return _changed(Place(front, control, problem), grain, course.is_done), step.h


class _AheadError(Exception):
    """The signal that a pass of a switch begins at the front of a step."""

    def __init__(self, ahead: Crossing) -> None:
        self.ahead = ahead


def _nearer(place: Place, ahead: Crossing, grain: float, why: str) -> tuple[TimeStep, Proof]:
    """A step, with its proof, that ends closer to a pass. It is used if the pass cannot be proved from the present
    place.

    ProofError if there is no such step.
    """
    problem, phase = place.problem, place.problem.phase
    nearer = ahead.nearer(grain)
    if nearer > 0:
        try:
            control = replace(place.control, h=nearer)
            return _step(replace(problem, phase=None), place.front, grain, control)
        except ProofError:
            pass
    assert phase is not None
    raise ProofError(phase.sentence(ahead.which[0], place.front.t + max(ahead.first, 0.0), why))


def _passed(course: Course, place: Place, ahead: Crossing, grain: float) -> Place:
    """The place after a pass that begins at a place. The course stores bounds of the outputs."""
    problem, front, control = place.problem, place.front, place.control
    if ahead.why or not ahead.first > 0:
        raise ProofError(ahead.why or "its sign may already change at this time")
    begin, about = front.t, window(problem, ahead)
    end = begin + float(np.ceil((ahead.last + ahead.first) / grain)) * grain
    if problem.change is not None and problem.change.late is not None and problem.change.time <= end:
        raise ProofError("a sampled value may change during the pass")
    # The old and the new motion overlap until all of the box has passed. Outputs during the pass need both.
    old, _ = _followed(replace(about.old, times=np.array([end])), front, control)

    scaled, h = Scaled(problem, begin, ahead.tau), min(1.0, control.h / ahead.last)
    to = scaled.problem(about.old, about.surface)
    there, at_pass = _followed(to, replace(front, t=0.0), replace(control, h=h))
    g = np.maximum(np.abs(there.bounds.lower), np.abs(there.bounds.upper))[-1]
    delay, lost = pass_errors(to, scaled, at_pass.front, about, ahead.first, g)
    if not above(delay) < ahead.first:
        raise ProofError("its sign may already change at this time")
    # The motion goes back from the passes to one time. From there on, all parameters have the same time again.
    back = scaled.problem(about.new, about.surface, is_back=True)
    new_begin = replace(at_pass.front, t=0.0, x_error=above(at_pass.front.x_error + lost))
    _, at_begin = _followed(back, new_begin, replace(control, h=h))
    new, last = _followed(replace(about.new, times=np.array([end])), replace(at_begin.front, t=begin), control)

    assert old.steps is not None and new.steps is not None and problem.phase is not None
    behind = int(np.searchsorted(problem.times, end, side="right"))
    if behind > course.stored:
        passes = ahead.tau.copy()
        passes[(0,) * passes.ndim] += begin
        part = Part(old.steps, new.steps, passes, delay + grain)  # the last term covers rounding
        course.store(behind, bounds_about_pass(part, problem.times[course.stored : behind], control))
    phase = replace(problem.phase, sides=about.sides)
    after = replace(last.problem, times=problem.times, phase=phase, change=problem.change)
    return Place(last.front, replace(last.control, h=control.h), _settled(after, last.front))


def _followed(problem: Problem, front: Front, control: Control) -> tuple[Course, Place]:
    """The course of a problem from a front to its last time, with its steps, and the last place.

    The last step ends exactly at the last time.
    """
    end = float(problem.times[-1])
    stop = Change(end, problem.rates, lambda time, problem: problem, late=0.0)
    course = replace(Course.empty(problem), steps=[])
    course.end = Place(front, replace(control), replace(problem, change=stop))
    march(problem, 0, course, np.inf, np.inf, lambda time: None)
    if course.why:
        raise ProofError(course.why)
    return course, course.end


def _settled(problem: Problem, front: Front) -> Problem:
    """The problem on the sides that its switches have at a front."""
    phase, place = problem.phase, (front.middle, problem.middle, front.t)
    if phase is None:
        return problem
    problem = problem.on_sides(phase.settled(*place, phase.sides), *place)
    assert problem.valid is not None
    require_known("the equations", problem.rates, problem.valid)
    return problem


def _left(problem: Problem, t: float, grain: float) -> float:
    """Time until a step must end [s]; infinite without a change of states."""
    change = problem.change
    if change is None or (change.late is None and change.time <= t + _UNITS_BEFORE_CHANGE * grain):
        return np.inf
    return change.time - t


def _late(problem: Problem, t: float) -> float | None:
    """The error of the prescribed time of a change at t [s]; None if t is not such a time."""
    change = problem.change
    return None if change is None or t != change.time else change.late


def _changed(place: Place, grain: float, is_done: bool) -> Place:
    """The place after the change of states, or the same place if the change is later."""
    problem, front = place.problem, place.front
    change, late = problem.change, _late(problem, front.t)
    soon = front.t + _UNITS_BEFORE_CHANGE * grain
    is_ahead = change is None or (late is None and (change.late is not None or change.time > soon))
    if is_done or change is None or is_ahead:
        return place
    if late is not None:
        front = drifted(problem, front, late)
    # the instant is known up to an error: the states before and after it contain those at nearby times
    front, problem = mapped(problem, front, change.states), change.following(front.t, problem)
    problem = _settled(problem, front)
    return replace(place, front=front if late is None else drifted(problem, front, late), problem=problem)


def _step(problem: Problem, front: Front, grain: float, control: Control) -> tuple[TimeStep, Proof]:
    """A proved step that begins at a front, and its proof.

    If the step cannot be proved, two further attempts follow: the first uses the initial choice of ellipses, because
    the adapted one may be bad for this step. The second also uses an orthogonal frame, because the frame may differ too
    much over the box.
    """
    aim = control.h
    for _ in range(2):
        try:
            return _shortened(problem, well_conditioned(problem, front), grain, control)
        except ProofError:
            control.choice, control.h = Choice(), aim
    return _shortened(problem, well_conditioned(problem, front, 0.0), grain, control)


def _shortened(problem: Problem, front: Front, grain: float, control: Control) -> tuple[TimeStep, Proof]:
    """A proved step of the aimed length, or a shorter step that can be proved with the present control."""
    h = aim = usual = control.h
    reason, failed, change, is_cut, A = "", 0, problem.change, False, jacobian(problem, front.middle, front.t)
    while h >= aim / 16 and h > 4 * grain:
        if change is None or change.late is None or h != change.time - front.t:
            h = float(np.floor(h / grain)) * grain
        try:
            x = motion(problem, front.x, front.t, h, _TIME_TERMS, A if is_stiff(A, h) else None)
        except ProofError as error:
            reason, aim = str(error), _SHORTER_STEP * h
            h = aim
            continue
        last = ch.sums(x.c[:, -2:], problem.axes).max(axis=1)
        sizes = np.maximum(problem.scales, ch.sums(x.c, problem.axes + 1))
        tail = float((last / sizes).max(initial=0.0))
        # with this length, the last coefficients of the motion would be as small as the rounding of the states
        h_resolved = h * float(np.clip((FACTORS / max(tail, 1e-30)) ** (1.0 / _TIME_TERMS), _SHORTER_STEP, 1.5))
        if tail > ROUNDING:
            aim = h = h_resolved
            continue
        step, before = None, _before_pass(problem, x.c, front.t, h, usual, grain)
        if before < h:
            aim = h = before
            is_cut = True
            continue
        try:
            step, w = (_in_decaying_frame if is_stiff(A, h) else _in_moving_frame)(problem, front, x, h)
            require_valid(step, np.zeros(problem.n))
            proof = prove(step, w, control)
            require_valid(step, above(step.B_largest @ proof.W))
            control.h = max(h_resolved, usual) if is_cut else h_resolved
            if failed or (control.lost and not is_cut):
                control.lost = max(0.0, control.lost + failed + 1.0 - 2.0 * h / _needed(problem, x.c, h))
            return step, proof
        except ProofError as error:
            reason, h, failed = str(error), 0.5 * h, failed + 1
            if step is not None and not is_regular(step, np.zeros(problem.n), Choice().patches):
                reason = problem.why_singular
    raise ProofError(reason or "the motion changes too fast for the shortest step")


def _needed(problem: Problem, c: Array, h: float) -> float:
    """Approximately the length of a step [s] in which the last terms of the motion are rounding errors.

    c (n, K + 1, ...) are the coefficients of the motion over a step h [s]. They decrease about as powers of h.
    """
    sizes = ch.sums(c, problem.axes)
    largest = (sizes / np.maximum(problem.scales, sizes.sum(axis=1))[:, None]).max(axis=0)
    terms = 1 + int(np.flatnonzero(largest > FACTORS).max(initial=0))
    return h * FACTORS ** (1.0 / _TIME_TERMS - 1.0 / terms)


def _in_moving_frame(problem: Problem, front: Front, x: Curve, h: float) -> tuple[TimeStep, Array]:
    """The step with a frame that moves with the motion, and bounds (m,) of |w| at its begin."""
    step = TimeStep(problem, front.t, h, x, *frame(problem, x.c, front.B, front.t, h))
    w = front.w.copy()
    w[-problem.n :] = above(w[-problem.n :] + step.inverse_times(front.x_error + front.B_error @ front.w))
    return step, w


def _in_decaying_frame(problem: Problem, front: Front, x: Curve, h: float) -> tuple[TimeStep, Array]:
    """The stiff step with the eigenvectors of its middle as a constant frame, and bounds (n,) of |w| at its begin."""
    middle = x.c[(slice(None), slice(None), *(0,) * problem.axes)] @ np.cos(0.5 * np.pi * np.arange(x.c.shape[1]))
    V, decay = decaying(jacobian(problem, middle, front.t + 0.5 * h), problem.scales)
    zero = (slice(None), slice(None), *(0,) * problem.axes)
    n, B = problem.n, np.zeros((problem.n, problem.n, *front.B.shape[2:]))
    C = B.copy()
    try:
        B[zero], C[zero] = V, np.linalg.inv(V)
    except np.linalg.LinAlgError:
        raise ProofError("in one step, some deviations from the computed motion grow much faster than others") from None
    w = in_frame(problem, front, B, C).w
    constant = integrated(B.reshape(n * n, *B.shape[2:]), np.zeros((n * n, 1, *B.shape[2:])), h)
    return TimeStep(problem, front.t, h, x, constant, C[:, :, None], decay), w


def _before_pass(problem: Problem, x: Array, t: float, h: float, usual: float, grain: float) -> float:
    """The longest step [s] with the motion x that ends before a pass of a switch. _AheadError if a pass is near."""
    ahead = None if problem.phase is None else crossing(problem, x, t, h, _TIME_TERMS, _UNITS_BEFORE_CHANGE * grain)
    if ahead is None:
        return np.inf
    nearer = ahead.nearer(grain)
    if ahead.why and nearer > 0:
        return nearer
    # the time to the pass must exceed the error of the time of the pass, which grows with the spread
    begin = usual / 64 + 0.25 * (ahead.last - ahead.first)
    if ahead.first <= 2.0 * begin:
        raise _AheadError(ahead)
    return float(np.floor((ahead.first - begin) / grain)) * grain
