"""Runs from one switch of the state to the next, with equations that are smooth between switches."""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from symmb._types import Array
from symmb.run import integrate

SideAdvance = Callable[[float, float, Array, Array], Array]
"""A function (begin, end, y, parameters) -> y at the end."""

_BREAKDOWNS = RuntimeError, np.linalg.LinAlgError


class Stops(NamedTuple):
    """Times at which steps of N samples end [s], infinite after the last one.

    Attributes
    ----------
    times : (N, k)           switches of time, and passes of switches of the state, in order
    passes : (N, m)          passes of switches of the state
    until : (N,)             times after which passes are not known
    sticks : (N,)            times at which motions stick to a switch and cannot continue
    """

    times: Array
    passes: Array
    until: Array
    sticks: Array

    def of(self, sample: int) -> "Stops":
        """The entries of one sample, with shapes (k,), (m,), () and ()."""
        return Stops(*(part[sample] for part in self))


def no_stops(n: int) -> Stops:
    """Step ends of n samples without switches."""
    return Stops(np.empty((n, 0)), np.empty((n, 0)), np.full(n, np.inf), np.full(n, np.inf))


def stops_at(passes: Array) -> Stops:
    """Stops of one sample at passes (m,) [s], nan after the last one. If no entry is nan, further passes may exist."""
    known = passes[~np.isnan(passes)]
    until = np.array(known[-1] if len(known) == len(passes) else np.inf)
    return Stops(known, known, until, np.array(np.inf))


class SideWalk:
    """The integration of one sample from stop to stop. The vector y has the state and the integrals along the motion.

    A piece is the motion between two stops. A run of another solver gives the times of passes of switches. At such a
    time, this run moves forward or back until it is on the switch. Forces that act over a short distance then do the
    correct work. If the motion is not on the expected sides at the end of a piece, the piece is integrated again. In
    this second integration, the state determines the sides.

    Parameters
    ----------
    equations : OneSided
    p : (n_p,)                   parameters of the sample
    stops : Stops                stops of the sample
    span : float                 horizon [s]
    one_sided : SideAdvance      advances y over a piece, or over a short time that may be negative. The sides are
                                 given as the last parameters
    free : SideAdvance           advances y over a piece. The state determines the sides
    """

    def __init__(
        self,
        equations: "integrate.OneSided",
        p: Array,
        stops: Stops,
        span: float,
        one_sided: SideAdvance,
        free: SideAdvance,
    ) -> None:
        self._equations, self._p, self._passes, self._until = equations, p, stops.passes, float(stops.until)
        self._one_sided, self._free = one_sided, free
        # Largest error of the times of passes, divided by the horizon. If an error is larger, the state determines the
        # sides.
        self._shift, self._least, self._next = 1e-4 * span, 1e-3 * span, 0
        self._sides: Array | None = None
        self._is_lost = False

    def piece(self, begin: float, end: float, y: Array) -> Array:
        """The vector y at the end of a piece between two stops."""
        first, self._next = self._next, int(np.searchsorted(self._passes, end + self._rounding(end)))
        if end > self._until:
            return self._free(begin, end, y, self._p)
        sides = self._equations.sides_at(y, self._p, begin) if self._sides is None else self._sides
        if self._is_lost and self._is_near_switch(begin, y, sides):
            return self._free(begin, end, y, self._p)
        due, arrived = self._next - first, None
        with suppress(*_BREAKDOWNS):
            new = self._one_sided(begin, end, y, np.concatenate([self._p, sides]))
            arrived = self._behind_passes(end, new, sides, due)
        if arrived is not None:
            return arrived
        new = self._free(begin, end, y, self._p)
        arrived = self._behind_passes(end, new, sides, due)
        return new if arrived is None else arrived

    def _behind_passes(self, t: float, y: Array, sides: Array, due: int) -> Array | None:
        """The vector y after `due` passes at the time t; None if the motion is then not on the expected sides."""
        self._sides = None
        with suppress(*_BREAKDOWNS):
            for _ in range(due):
                y, sides = self._passed(t, y, sides)
            self._sides = sides if self._fits(t, y, sides) else None
        self._is_lost = self._sides is None
        return None if self._is_lost else y

    def _is_near_switch(self, t: float, y: Array, sides: Array) -> bool:
        """Whether the motion may be on another side of a switch than the run that reported the passes."""
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        return bool((np.abs(values) <= self._shift * np.abs(rates)).any())

    def _passed(self, t: float, y: Array, sides: Array) -> tuple[Array, Array]:
        """The vector y on the next switch that the motion passes, and the sides after this switch. The time of y
        remains t."""
        late, k = self._late(t, y, sides)
        if not late < np.inf:
            return y, sides
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        # Fraction of the error of the times of passes. If the motion needs more time to the switch, but its distance is
        # rounding, it hardly moves towards the switch, and is not moved.
        if abs(late) > 0.01 * self._shift and abs(values[k]) <= self._margins(rates, t)[k]:
            return y, self._behind(t, y, sides, k)
        new, to, parameters = y, t, np.concatenate([self._p, sides])
        # Number of Newton steps to find the pass of this run, from the given time of the pass.
        for _ in range(5):
            new = self._one_sided(to, to + late, new, parameters)
            to += late
            values, rates = self._equations.on_sides(new, self._p, sides, t)
            if not rates[k]:  # the motion touches the switch here
                break
            late = float(-values[k] / rates[k])
            if abs(late) <= np.spacing(abs(t)):
                break
        is_there = abs(values[k]) <= self._margins(rates, t)[k] and abs(to - t) <= self._shift
        y = new if is_there else y
        return y, self._behind(t, y, sides, k)

    def _behind(self, t: float, y: Array, sides: Array, k: int) -> Array:
        """The sides after switch number k, and after other switches that jump together with it."""
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        sides, may_jump = sides.copy(), values >= -self._margins(rates, t)
        while True:  # one by one, because switches depend on the sides of earlier switches
            sides[k], may_jump[k] = -sides[k], False
            values, rates = self._equations.on_sides(y, self._p, sides, t)
            jumps = may_jump & (values < -self._margins(rates, t))
            if not jumps.any():
                return sides
            k = int(jumps.argmax())

    def _late(self, t: float, y: Array, sides: Array) -> tuple[float, int]:
        """The time from t to the next pass (negative before t, infinite if there is none), and number of the switch."""
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        with np.errstate(all="ignore"):
            late = np.where(rates < 0, -values / rates, np.inf)
        far = np.abs(late)
        # A switch may be the next one if its time is at most this multiple of the time to the nearest switch. Pieces,
        # which may be shorter than the error of the times, pass the other switches.
        late[~(far <= min(self._shift, 10.0 * far.min(initial=np.inf) + self._rounding(t)))] = np.inf
        return float(late.min()), int(late.argmin())

    def _fits(self, t: float, y: Array, sides: Array) -> bool:
        """Whether the motion is on its sides, or has left them for a time below the error of the times of passes."""
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        on_side = values >= -self._margins(rates, t)
        return bool(np.all(on_side | ((rates < 0) & (values >= self._shift * rates))))

    def _margins(self, rates: Array, t: float) -> Array:
        """Changes of switches (m,) that rounding of the state and of the time can cause."""
        return self._equations.hysteresis + self._rounding(t) * np.abs(rates)

    def _rounding(self, t: float) -> float:
        """A time that is longer than the distance at which pieces end before a stop at t."""
        return 8 * float(np.spacing(max(abs(t), self._least)))
