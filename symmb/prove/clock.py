"""A clock for each set of parameters, so that all parameters reach the same phase of a motion at the same time.

With the time t = s tau(p), the rates are dx/ds = tau(p) f(x, p, s tau(p)). Any polynomial tau gives valid bounds. A
good one removes the part of the effect of the parameters that is a delay: a turning machine with a slightly different
period otherwise needs polynomials of a high order, and its steps have to be short. At a time t, each set of parameters
is at its own place s = t / tau(p), perhaps in another step than its neighbours.

Source: Mai and Sudret, International Journal for Uncertainty Quantification 7 (2017), time warping.
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.declare.symbolic import common
from symmb.prove.basis import basis_of
from symmb.prove.ellipses import Control
from symmb.prove.orders import computed_motion
from symmb.prove.outputs import OutputBounds, output_bounds
from symmb.prove.pass_outputs import Steps, half_step
from symmb.prove.passes import Scaled, reach_of
from symmb.prove.problem import Clock, Problem
from symmb.prove.rounding import U, above
from symmb.prove.several_parameters import places_in_step
from symmb.prove.terms import sums_of_orders
from symmb.prove.time_step import TimeStep

_DELAY = 0.8
"""Smallest fraction of the effect of the parameters that is a delay, at times that count for a clock."""
_ROUGH = 0.15
"""Second-order terms of a motion, relative to the effect of the parameters, above which a time counts for a clock."""
_GAIN = 0.5
"""Largest fraction of the second-order terms that may remain with a clock. With a constant delay, more remain."""
_LARGEST_CHANGE = 0.5
"""Largest relative change of the rate of time over the box."""
_BEYOND = 1.5
"""Largest place at which the polynomials of a step are evaluated. Its ends are -1 and 1. Farther beyond the ends they
differ much from the motion, and the bounds would be wide."""
_MOST_HALVINGS = 6
"""Largest number of halvings of the box until all places of a part are near the step."""


def with_clock(problem: Problem) -> Problem:
    """The problem with a clock, if the effect of many parameters is mainly a delay where it is least linear.

    The motions are computed without a proof.
    """
    if not problem.weights or problem.phase is not None or problem.change is not None:
        return problem
    plain = replace(problem, weights=(1,) * problem.d)
    degrees = plain.basis(plain.lengths(2)[0]).exponents.sum(axis=1)
    rates, weights, others, sizes, seconds = [], [], 0.0, 1e-12 * problem.scales, [np.zeros(problem.n)]
    for t, x in computed_motion(plain):
        moved, second = (np.abs(x[:, which]).sum(axis=1) for which in (degrees > 0, degrees == 2))
        sizes = np.maximum(sizes, moved)
        seconds.append(second)
        share = (second / sizes).sum() / ((moved - second) / sizes).sum()
        if not (share > _ROUGH and t > 0):
            continue
        delay = _delay(plain, t, x, sizes, degrees == 1)
        if delay is None:
            others += share - _ROUGH
        else:
            rates.append(-delay / t)
            weights.append(share - _ROUGH)
    if not sum(weights) > others:
        return problem
    tau = np.average(rates, axis=0, weights=weights)
    tau[0] = 1.0
    if not reach_of(plain, tau) < _LARGEST_CHANGE:
        return problem
    left = [np.abs(x[:, degrees == 2]).sum(axis=1) for _, x in computed_motion(_by(plain, tau, plain))]
    largest, others = (float((np.array(own) / sizes).sum(axis=1).max()) for own in (left, seconds))
    return _by(plain, tau, problem) if largest < _GAIN * others else problem


def _by(plain: Problem, tau: Array, problem: Problem) -> Problem:
    """A problem with the clock tau (T,), a polynomial of the basis of the problem `plain`."""
    scaled, reach = Scaled(plain, 0.0, tau), reach_of(plain, tau)
    rate = scaled.of(common("one", problem.rates.sx_in(), [ca.SX(1)]), 1.0)
    clock = Clock(rate, (1.0 - reach) * (1.0 - 8 * U), (1.0 + reach) * (1.0 + 8 * U))
    own = scaled.problem(problem, problem.outputs)
    return replace(own, times=problem.times, refused=problem.refused, clock=clock)


def _delay(problem: Problem, t: float, x: Array, sizes: Array, is_linear: Mask) -> Array | None:
    """The time (T,) by which motions are ahead of that in the middle of the box, at states x (n, T) and the time t.

    The effects of the parameters on the states are compared with `sizes` (n,). None if the linear effect is mainly
    another one.
    """
    f = problem.rates(x[:, 0], problem.middle, t).full().ravel() / sizes
    x = x / sizes[:, None]
    delay = f @ x / (f @ f)
    linear = x[:, is_linear]
    rest = linear - np.outer(f, delay[is_linear])
    return delay if (rest**2).sum() < (1.0 - _DELAY) * (linear**2).sum() else None


def bounds_by_clock(steps: Steps, times: Array, control: Control) -> OutputBounds:
    """Bounds of the outputs at times (n_t,), from all steps in which some parameters are at these times."""
    bounds = OutputBounds.nothing(len(times), steps[0][0].problem.outputs.numel_out(0))
    for step, w in steps:
        assert step.problem.clock is not None
        if above((step.t0 + step.h) * step.problem.clock.fastest) < times[0]:
            continue  # all parameters are beyond the step
        bounds = bounds.joined(_of_part(step, w, times, control, _MOST_HALVINGS))
    return bounds


def _of_part(step: TimeStep, w: Array, times: Array, control: Control, halvings: int) -> OutputBounds:
    """Bounds at times (n_t,) for the parameters that are in the step then, or close to it; otherwise empty bounds."""
    problem = step.problem
    bounds = OutputBounds.nothing(len(times), problem.outputs.numel_out(0))
    # near places need no more than this degree
    s = places_in_step(step, times, basis_of(problem.weights, 2))
    end = 1.0 + 8 * U  # rounding must not leave out the parameters at the end of a step
    here = ~((s.c[0] - s.swing > end) | (s.c[0] + s.swing < -end))
    if not here.any():
        return bounds
    if halvings and (np.abs(s.c[0]) + s.swing)[here].max() > _BEYOND:
        variable = int(np.argmax([own[1:].sum() for own in sums_of_orders(problem, s.in_chebyshev(len(times)).T)]))
        for side in (-1, 1):
            own = _of_part(half_step(step, variable, side), w, times[here], control, halvings - 1)
            bounds.put(here, bounds.at(here).joined(own))
    else:
        bounds.put(here, output_bounds(step, w, times[here], control))
    return bounds
