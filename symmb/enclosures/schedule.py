"""Laws of time that switch: equations between two switches, and how a proof goes over one.

The equations of each phase are smooth beyond its ends as well. A switch that all parameters have at about one time is
in a window of time, before which the old equations are proved to hold, and behind which the new ones. Inside, the
rates are those of any sides of the switches that change. A solution of the old equations is followed to the end of the
window, where the true one is off it by at most the length of the window times the rates of both.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.events import TimeSwitches
from symmb.symbolic import common

_GRAINS = 2.0**30
"""Steps are multiples of a power of 2, that of the horizon over this: times of steps are then sums without rounding."""
_FINE = 2.0**50
_MARGIN = 4
"""Grains between a switch and both ends of its window: times of switches are sought to some digits less."""
_TOGETHER = 4
"""Most switches that change in one window: each doubles the rates that are bounded there."""
_CORNERS = 256
"""Random corners of the box at which switches are sought. Proofs do not rely on it."""
_AFTER = 1e-9
"""Share of the horizon after the begin of a phase at which sides are chosen: at the begin itself a law may switch."""


def grain_of(end: float) -> float:
    """The unit of times of steps over a horizon [s]."""
    return 2.0 ** float(np.ceil(np.log2(end or 1.0))) / _GRAINS


def fine_grain_of(end: float) -> float:
    """The unit of times that are given: sums of so many are exact as well, with two bits to spare."""
    return grain_of(end) * _GRAINS / _FINE


@dataclass(frozen=True, eq=False)
class Phase:
    """Equations between two switches.

    Attributes
    ----------
    rates : (x, p, t) -> x'
    valid : (x, p, t) -> (m,), all above 0 as long as the rates are those of the scene; None: always
    stop : time at which the window of the next switch begins, from the first time on [s]; infinite if there is none
    resume : time at which it ends
    why : the sentence that tells of this switch
    window : what is known inside; None if a proof cannot go over it
    """

    rates: ca.Function
    valid: ca.Function | None = None
    stop: float = np.inf
    resume: float = np.inf
    why: str = ""
    window: "Window | None" = None


@dataclass(frozen=True, eq=False)
class Window:
    """What holds while laws switch.

    Attributes
    ----------
    rates : Functions (x, p, t) -> x', one of which gives the rates at each time
    steady : (x, p, t) -> (m,), all above 0 as long as that is so
    following : () -> the next phase
    """

    rates: tuple[ca.Function, ...]
    steady: ca.Function
    following: Callable[[], Phase]


@dataclass(eq=False)
class Schedule:
    """The phases of equations whose laws of time switch.

    Attributes
    ----------
    rates : (x, p, t, sides) -> x'
    switches : (x, p, t, sides) -> (m,) what changes its sign with each side, of p and t alone
    horizon : last time, from the first one on [s]
    samples : (N, n_p) parameters at which switches are sought
    begin : the first time [s], for sentences
    names : of the kinks and jumps
    """

    rates: ca.Function
    switches: ca.Function
    horizon: float
    samples: Array
    begin: float
    names: str
    _phases: dict[float, Phase] = field(default_factory=dict)

    def phase(self, begin: float) -> Phase:
        """The one that begins at a time, from the first one on [s]."""
        if begin not in self._phases:
            self._phases[begin] = self._phase(begin)
        return self._phases[begin]

    def _phase(self, begin: float) -> Phase:
        sides = self._sides(begin)
        x, p, t = (ca.SX.sym(name, self.rates.numel_in(i)) for i, name in enumerate("xpt"))
        switches = sides * self.switches(x, p, t, sides)
        rates, valid = self._on(sides), common("valid", [x, p, t], [ca.densify(switches)])
        times = np.array([begin, max(self.horizon, begin)])
        switch_times = TimeSwitches(valid(0, p, t), p, t, times)(self.samples)
        if not len(sides) or not switch_times.shape[1]:
            return Phase(rates, valid if len(sides) else None)
        first, last = float(switch_times[:, 0].min()), float(switch_times[:, 0].max())
        why = f"the equations have {self.names} at t = {first + self.begin + 0.0:.6g} s"  # not -0
        grain = grain_of(self.horizon)
        stop, resume = (np.floor(first / grain) - _MARGIN) * grain, (np.ceil(last / grain) + _MARGIN) * grain
        if not (stop > begin and resume - stop <= 4 * _MARGIN * grain):
            return Phase(rates, valid, max(np.floor(first / grain) * grain, begin), why=why)
        return Phase(rates, valid, stop, resume, why, self._window(sides, resume))

    def _window(self, sides: Array, resume: float) -> Window | None:
        changed = np.flatnonzero(sides != self._sides(resume))
        if len(changed) > _TOGETHER:
            return None
        x, p, t = (ca.SX.sym(name, self.rates.numel_in(i)) for i, name in enumerate("xpt"))
        rates, steady = [], [ca.SX(1)]
        same = np.setdiff1d(np.arange(len(sides)), changed).tolist()
        for signs in product((1.0, -1.0), repeat=len(changed)):
            between = sides.copy()
            between[changed] = signs
            rates.append(self._on(between))
            values = ca.vertsplit(between * self.switches(x, p, t, between))
            steady += [values[k] for k in same]
        unchanged = common("steady", [x, p, t], [ca.densify(ca.vertcat(*steady))])
        return Window(tuple(rates), unchanged, lambda: self.phase(resume))

    def _on(self, sides: Array) -> ca.Function:
        x, p, t = (ca.SX.sym(name, self.rates.numel_in(i)) for i, name in enumerate("xpt"))
        return common("rates", [x, p, t], [ca.densify(self.rates(x, p, t, sides))])

    def _sides(self, begin: float) -> Array:
        """Sides (m,) after a time at the nominal parameters. A switch may depend on the sides of those before it."""
        sides = np.ones(self.switches.numel_out(0))
        for _ in range(len(sides)):
            values = self.switches(0, self.samples[0], begin + _AFTER * self.horizon, sides)
            sides = np.where(values.full().ravel() >= 0, 1.0, -1.0)
        return sides


def corners(middle: Array, radius: Array) -> Array:
    """The middle of a box and random corners (N, n_p)."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (_CORNERS, len(middle)))
    return np.vstack([middle, middle + radius * signs])
