"""Times of kinks and jumps of equations of motion that depend only on time and parameters."""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from symmb._types import Array, Mask
from symmb.declare.symbolic import On, Pieces, batch, batch_padded, branches, common, has_kinks, ranges_along
from symmb.run.schemes import roots

_PARTS, _HALVINGS, _MOST_PARTS = 64, 30, 1_000_000
"""First number of parts of the horizon, maximum number of bisections of a part, and maximum number of parts. A part is
halved if it may contain more sign changes than its ends show. A part that remains undecided is a jump. Two changes
within a shortest part, about 1e-10 of the horizon, are not found."""


class TimeSwitches:
    """Switches of time for samples of parameters.

    Parameters
    ----------
    switches : (k,) SX       expressions of p and t, which change their sign at the kinks and jumps
    p, t : SX symbols        parameters and time
    times : (n_t,) array     output times [s]; switches outside their range are ignored
    knots : list             arguments of tables, expressions of p and t, and pieces. Tables switch at their knots
    instants : (k,) array    further switches, equal for all samples [s]
    """

    def __init__(
        self,
        switches: ca.SX,
        p: ca.SX,
        t: ca.SX,
        times: Array,
        instants: Array | None = None,
        knots: Sequence[tuple[ca.SX, Pieces]] = (),
    ) -> None:
        self._instants = np.empty(0) if instants is None else instants
        self._begin, self._end = float(times[0]), float(times[-1])
        self._tables = [_Knots(at, pieces.knots, p, t, times) for at, pieces in knots if not _is_linear(at, p, t)]
        knots = [(at, pieces) for at, pieces in knots if _is_linear(at, p, t)]
        switches = ca.vertcat(ca.SX(0, 1), switches, *(at for at, _ in knots))
        self._places = [pieces.knots for _, pieces in knots]
        slopes = ca.densify(ca.jacobian(switches, t))
        is_linear = [_is_linear(switch, p, t) for switch in ca.vertsplit(switches)]
        linear = ca.substitute(ca.horzcat(switches, slopes)[np.flatnonzero(is_linear).tolist(), :], t, 0)
        curved = switches[np.flatnonzero(np.logical_not(is_linear)).tolist()]
        box, bounds = ranges_along(curved, ca.SX(0, 1), p, t)
        self._linear = ca.Function("linear", [p], [linear[:, 0], linear[:, 1]])
        self._curved = ca.Function("curved", [p, t], [ca.densify(curved)])
        self._bounds = common("bounds", [p, box], [bounds])
        self._depends = ca.depends_on(curved, p)

    @property
    def linear(self) -> tuple[ca.Function, list[Array]] | None:
        """A function (p) -> values (k,) at time 0 and slopes (k,), and knots (m,); None if some switches are nonlinear.

        The first values switch at 0, and the last values at the knots.
        """
        return None if self._curved.numel_out(0) or self._tables else (self._linear, self._places)

    def of_all_samples(self) -> Array:
        """Times (k,) of sampling instants, and of nonlinear switches without parameters [s]."""
        none = np.zeros(self._linear.numel_in(0))
        curved = self._curved_roots(none) if self._curved.numel_out(0) and not self._depends else np.empty(0)
        tables = [table(none[None])[0] for table in self._tables if not table.depends]
        return np.unique(np.concatenate([self._instants, curved, *tables]))

    def __call__(self, p: Array) -> Array:
        """Ordered times (N, k) of the switches of N samples p (N, n_p), padded with inf [s]."""
        p = p[:, : self._linear.numel_in(0)]
        switches = [np.broadcast_to(self._instants, (len(p), len(self._instants)))]
        if self._linear.numel_out(0):
            at_zero, slope = batch(self._linear, p)
            with np.errstate(all="ignore"):
                count = at_zero.shape[1] - len(self._places)
                switches.append(-at_zero[:, :count] / slope[:, :count])
                for k, places in enumerate(self._places, count):
                    switches.append((places - at_zero[:, k : k + 1]) / slope[:, k : k + 1])
        if self._curved.numel_out(0):
            switches.append(_padded([self._curved_roots(row) for row in (p if self._depends else p[:1])], len(p)))
        switches += [table(p) for table in self._tables]
        times = np.concatenate([np.full((len(p), 0), np.inf), *switches], axis=1)
        times[~((times >= self._begin) & (times <= self._end))] = np.inf
        times = np.sort(times, axis=1)
        with np.errstate(invalid="ignore"):
            # Number of rounding errors of a time within which two switches are the same.
            same = np.diff(times, axis=1) <= 8 * np.spacing(np.abs(times[:, 1:]))
        times[:, 1:][same] = np.inf
        times = np.sort(times, axis=1)
        return times[:, : int(np.isfinite(times).sum(axis=1).max(initial=0))]

    def _curved_roots(self, p: Array) -> Array:
        """Times (k,) at which a switch of one sample p (n_p,) changes its sign [s]."""
        # Fraction at which parts are divided, and power that makes the first parts unequal. Their ends then do not
        # coincide with jumps at whole periods.
        ends = self._begin + (self._end - self._begin) * (np.arange(_PARTS + 1) / _PARTS) ** 1.01
        low, high = ends[:-1], ends[1:]
        at_low, at_high = self._values(p, low), self._values(p, high)
        found: list[tuple[Any, ...]] = []
        for halvings in range(_HALVINGS + 1):
            with np.errstate(all="ignore"):
                is_open: Mask = np.atleast_1d(~self._told(p, low, high, at_low, at_high).all(axis=1))
            is_open &= halvings < _HALVINGS and 2 * np.count_nonzero(is_open) <= _MOST_PARTS
            part, which = np.nonzero(~is_open[:, None] & ((at_low > 0) != (at_high > 0)))
            found.append((which, low[part], high[part], at_low[part, which], at_high[part, which]))
            low, high, at_low, at_high = low[is_open], high[is_open], at_low[is_open], at_high[is_open]
            middle = low + 0.487 * (high - low)
            at_middle = self._values(p, middle)
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            at_low, at_high = np.concatenate([at_low, at_middle]), np.concatenate([at_middle, at_high])
        which, low, high, at_low, at_high = (np.concatenate(part) for part in zip(*found, strict=True))
        if not len(which):
            return low
        every = np.arange(len(which))
        return roots(lambda t: self._values(p, t)[every, which], low, high, at_low, at_high)

    def _values(self, p: Array, t: Array) -> Array:
        """The values (k, m) of the switches at times t (k,)."""
        if not len(t):
            return np.empty((0, self._curved.numel_out(0)))
        return batch_padded(self._curved, np.broadcast_to(p, (len(t), len(p))), t[:, None])[0]

    def _told(self, p: Array, low: Array, high: Array, at_low: Array, at_high: Array) -> Mask:
        """Mask of intervals in which the values (k, m) at the ends low and high (k,) show every sign change."""
        if not len(low):
            return np.ones(at_low.shape, dtype=bool)
        box = np.column_stack([low, high, high - low])
        bounds = batch_padded(self._bounds, np.broadcast_to(p, (len(low), len(p))), box)[0]
        least, largest, fall, rise = np.split(bounds, 4, axis=1)
        up = at_low > 0
        toward, away = np.where(up, -fall, rise), np.where(up, rise, -fall)
        between = (up == (at_high > 0)) & (np.abs(at_low) * away + np.abs(at_high) * toward > toward * away)
        # Fraction of a range. Values may deviate from the range by this fraction. A value with a larger deviation is on
        # the other side of a jump.
        margin = 1e-6 * (np.abs(least) + np.abs(largest))
        exact = (np.minimum(at_low, at_high) >= least - margin) & (np.maximum(at_low, at_high) <= largest + margin)
        return np.asarray(exact & ((least > 0) | (largest < 0) | (fall >= 0) | (rise <= 0) | between))


class _Knots:
    """Times at which the argument of a table reaches a knot. The argument is a curved function of time."""

    def __init__(self, at: ca.SX, knots: Array, p: ca.SX, t: ca.SX, times: Array) -> None:
        self._at, self._knots, self.depends = ca.Function("at", [p, t], [at]), knots, ca.depends_on(at, p)
        branch, slope = branches(common("at", [p, t], [at]), [(p, On.PARAMETERS), (t, On.TIME)]), ca.jacobian(at, t)
        turns = ca.vertcat(branch.times, slope if ca.depends_on(slope, t) else ca.SX(0, 1))
        self._turns, self._ends = TimeSwitches(turns, p, t, times, knots=branch.knots), (times[0], times[-1])

    def __call__(self, p: Array) -> Array:
        """The times (N, k) of N samples p (N, n_p), padded with inf [s]."""
        some = p if self.depends else p[:1]
        return _padded([self._of(row, turns) for row, turns in zip(some, self._turns(some), strict=True)], len(p))

    def _of(self, p: Array, turns: Array) -> Array:
        """Times of one sample [s]. The argument is monotonic between `turns`, which are its extrema and jumps."""

        def values(t: Array) -> Array:
            if not len(t):
                return t
            return batch_padded(self._at, np.broadcast_to(p, (len(t), len(p))), t[:, None])[0][:, 0]

        ends = np.unique([*self._ends, *turns[np.isfinite(turns)]])
        # Number of rounding errors between a jump and a time beside it. It is twice the distance below which switches
        # are equal.
        margin = 16 * np.spacing(np.maximum(np.abs(ends[:-1]), np.abs(ends[1:])))
        low, high = ends[:-1] + margin, ends[1:] - margin
        low, high = low[low < high], high[low < high]
        at_low, at_high = values(low), values(high)
        first = np.searchsorted(self._knots, np.minimum(at_low, at_high), "right")
        counts = np.maximum(np.searchsorted(self._knots, np.maximum(at_low, at_high)) - first, 0)
        part = np.repeat(np.arange(len(low)), counts)
        knot = self._knots[np.arange(len(part)) + np.repeat(first - np.cumsum(counts) + counts, counts)]
        if not len(part):
            return np.empty(0)
        return roots(lambda t: values(t) - knot, low[part], high[part], at_low[part] - knot, at_high[part] - knot)


def _padded(rows: Sequence[Array], count: int) -> Array:
    """Rows of different lengths, or one row for all samples, as an array (count, k), padded with inf."""
    longest = max(map(len, rows), default=0)
    padded = [np.pad(row, (0, longest - len(row)), constant_values=np.inf) for row in rows]
    return np.broadcast_to(np.array(padded).reshape(len(rows), longest), (count, longest))


def _is_linear(switch: ca.SX, p: ca.SX, t: ca.SX) -> bool:
    """Whether the expression has a constant slope and no jumps, unlike a sawtooth."""
    return not ca.depends_on(ca.jacobian(switch, t), t) and not has_kinks(ca.Function("f", [p, t], [switch]))
