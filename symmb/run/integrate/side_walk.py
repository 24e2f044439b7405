"""Runs from one switch of the state to the next, on equations that are smooth in between."""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from symmb._types import Array
from symmb.run.integrate.one_sided import OneSided

SideAdvance = Callable[[float, float, Array, Array], Array]
"""A function (begin, end, y, parameters) -> y at the end."""

_BREAKDOWNS = RuntimeError, np.linalg.LinAlgError


class Stops(NamedTuple):
    """Where steps of N samples end, infinite behind the last one [s].

    Attributes
    ----------
    times : (N, k)           switches of time, and passes of switches of the state, in order
    passes : (N, m)          the latter alone
    until : (N,)             times from which on passes are not known
    sticks : (N,)            times at which motions stick to a switch, and none goes on
    """

    times: Array
    passes: Array
    until: Array
    sticks: Array

    def of(self, sample: int) -> "Stops":
        """The entries of one sample: (k,), (m,), () and ()."""
        return Stops(*(part[sample] for part in self))


def no_stops(n: int) -> Stops:
    """Step ends of n samples without switches."""
    return Stops(np.empty((n, 0)), np.empty((n, 0)), np.full(n, np.inf), np.full(n, np.inf))


def stops_at(passes: Array) -> Stops:
    """Passes (m,) of one sample [s], nan after the last one. There may be further passes if no entry is nan."""
    known = passes[~np.isnan(passes)]
    until = np.array(known[-1] if len(known) == len(passes) else np.inf)
    return Stops(known, known, until, np.array(np.inf))


class SideWalk:
    """One sample's way along pieces of its run, y being its state and whatever is integrated along.

    A run of another solver tells when switches are passed. There this run's own motion is moved on, or back, by the
    time that it needs to be on the switch: forces that jump over a short way then do the work of that way. Pieces whose
    branches the motion does not fit at the end are run again with branches that follow the state.

    Parameters
    ----------
    equations : OneSided
    p : (n_p,)                   of one sample
    stops : Stops                of this sample
    span : float                 horizon [s]
    one_sided : SideAdvance      by the equations of sides, which are the last parameters: along a piece, and by a time
                                 that is short or below 0
    free : SideAdvance           along a piece by equations that follow the state
    """

    def __init__(
        self, equations: OneSided, p: Array, stops: Stops, span: float, one_sided: SideAdvance, free: SideAdvance
    ) -> None:
        self._equations, self._p, self._passes, self._until = equations, p, stops.passes, float(stops.until)
        self._one_sided, self._free = one_sided, free
        # Largest error of the times of passes divided by the horizon. A motion with a larger error takes branches from
        # its own switches.
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
        """The vector y after the passes at its time; None if the motion is not on the sides after these passes."""
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
        """The vector y on the next switch that the motion passes, and the sides after it. Its time remains the time of
        the pass."""
        late, k = self._late(t, y, sides)
        if not late < np.inf:
            return y, sides
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        # Fraction of this error above which rounding of a switch is ignored, because the motion hardly moves along
        # the switch.
        if abs(late) > 0.01 * self._shift and abs(values[k]) <= self._margins(rates, t)[k]:
            return y, self._behind(t, y, sides, k)
        new, to, parameters = y, t, np.concatenate([self._p, sides])
        # Number of Newton steps from the time of a pass to the pass of this run.
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
        while True:  # one by one: switches depend on the sides of those before them
            sides[k], may_jump[k] = -sides[k], False
            values, rates = self._equations.on_sides(y, self._p, sides, t)
            jumps = may_jump & (values < -self._margins(rates, t))
            if not jumps.any():
                return sides
            k = int(jumps.argmax())

    def _late(self, t: float, y: Array, sides: Array) -> tuple[float, int]:
        """The time after t, or before t, at which the motion passes its next switch; infinite if there is none."""
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        with np.errstate(all="ignore"):
            late = np.where(rates < 0, -values / rates, np.inf)
        far = np.abs(late)
        # Ratio of the time to a switch to the time to the nearest switch, up to which it may be the next one. Other
        # switches are passed by pieces, which may be shorter than the error of the times.
        late[~(far <= min(self._shift, 10.0 * far.min(initial=np.inf) + self._rounding(t)))] = np.inf
        return float(late.min()), int(late.argmin())

    def _fits(self, t: float, y: Array, sides: Array) -> bool:
        """Whether the motion is on its sides, or beyond them by no more than the error of the times of passes."""
        values, rates = self._equations.on_sides(y, self._p, sides, t)
        on_side = values >= -self._margins(rates, t)
        return bool(np.all(on_side | ((rates < 0) & (values >= self._shift * rates))))

    def _margins(self, rates: Array, t: float) -> Array:
        """Changes of switches (m,) that are caused by rounding, also by rounding of the time."""
        return self._equations.hysteresis + self._rounding(t) * np.abs(rates)

    def _rounding(self, t: float) -> float:
        """A time that is longer than the distance at which pieces end before a stop at t."""
        return 8 * float(np.spacing(max(abs(t), self._least)))
