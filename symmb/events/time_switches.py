"""Times at which equations of motion have kinks or jumps that depend on time, and perhaps on parameters, alone."""

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.schemes import roots
from symmb.symbolic import batch

_LOOKS, _MOST_LOOKS = 400, 1_000_000
"""A fifth of the parts of the horizon in each of which a switch that is not linear in time, and its slope, may change
sign once. There are more parts if they change often, but not more than the second number."""
_UNEVEN, _GOLDEN = 0.5, 0.6180339887498949
"""Share of a part by which its begin is moved, after the multiples of the golden section."""


class TimeSwitches:
    """Switches of time for samples of parameters.

    Parameters
    ----------
    switches : (k,) SX       what changes sign at the kinks and jumps, of p and t
    p, t : SX symbols
    times : (n_t,) array     output times; switches outside do not count
    instants : (k,) array    further switches, of all samples [s]
    """

    def __init__(self, switches: ca.SX, p: ca.SX, t: ca.SX, times: Array, instants: Array | None = None) -> None:
        self._instants = np.empty(0) if instants is None else instants
        self._begin, self._end = float(times[0]), float(times[-1])
        slopes = ca.densify(ca.jacobian(switches, t))
        is_linear = [not ca.depends_on(slope, t) for slope in ca.vertsplit(slopes)]
        pairs = ca.horzcat(switches, slopes)
        linear = ca.substitute(pairs[np.flatnonzero(is_linear).tolist(), :], t, 0)
        curved = pairs[np.flatnonzero(np.logical_not(is_linear)).tolist(), :]
        self._linear = ca.Function("linear", [p], [linear[:, 0], linear[:, 1]])
        self._curved = ca.Function("curved", [p, t], [curved[:, 0], curved[:, 1]])
        self._depends = ca.depends_on(curved, p)

    def __call__(self, p: Array) -> Array:
        """Switches (N, k) of N samples p (N, n_p) in order, infinite behind the last one [s]."""
        p = p[:, : self._linear.numel_in(0)]
        switches = [np.broadcast_to(self._instants, (len(p), len(self._instants)))]
        if self._linear.numel_out(0):
            at_zero, slope = batch(self._linear, p)
            with np.errstate(all="ignore"):
                switches.append(-at_zero / slope)
        if self._curved.numel_out(0):
            rows = [self._curved_roots(row) for row in (p if self._depends else p[:1])]
            longest = max(map(len, rows), default=0)
            padded = np.array([np.pad(row, (0, longest - len(row)), constant_values=np.inf) for row in rows])
            switches.append(np.broadcast_to(padded, (len(p), longest)))
        times = np.concatenate([np.full((len(p), 0), np.inf), *switches], axis=1)
        times[~((times >= self._begin) & (times <= self._end))] = np.inf
        times = np.sort(times, axis=1)
        return times[:, : int(np.isfinite(times).sum(axis=1).max(initial=0))]

    def _curved_roots(self, p: Array) -> Array:
        """Times (k,) at which some switch of one sample p (n_p,) changes its sign."""
        looks, changes = _LOOKS, _LOOKS
        while looks <= _MOST_LOOKS and changes > 0.1 * looks:  # switches that oscillate
            looks *= 5
            # Equally spaced times might all have the same phase of an oscillation.
            shares = np.arange(looks) + _UNEVEN * (np.arange(looks) * _GOLDEN % 1)
            t = np.append(self._begin + (self._end - self._begin) * shares / looks, self._end)
            values, slopes = batch(self._curved, p, t[:, None])
            changes = int(np.diff(values > 0, axis=0).sum() + np.diff(slopes > 0, axis=0).sum())
        turns = (values[:-1] * values[1:] > 0) & (slopes[:-1] * values[:-1] < 0) & (slopes[1:] * values[1:] > 0)
        part, which = np.nonzero(turns)
        turn = self._roots(p, 1, which, t[part], t[part + 1])
        there = batch(self._curved, p, turn[:, None])[0][np.arange(len(turn)), which] if len(turn) else turn
        twice = there * values[part, which] < 0
        part, which, turn = part[twice], which[twice], turn[twice]
        crossed, by = np.nonzero((values[:-1] > 0) != (values[1:] > 0))
        low = np.concatenate([t[crossed], t[part], turn])
        high = np.concatenate([t[crossed + 1], turn, t[part + 1]])
        return self._roots(p, 0, np.concatenate([by, which, which]), low, high)

    def _roots(self, p: Array, number: int, which: Indices, low: Array, high: Array) -> Array:
        """Roots of switches, or with number 1 of their slopes, between times low and high (m,)."""
        if not len(which):
            return low

        def value(t: Array) -> Array:
            return batch(self._curved, p, t[:, None])[number][np.arange(len(which)), which]

        return roots(value, low, high, value(low), value(high))
