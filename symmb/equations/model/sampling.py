"""Sampled values of a system, with compiled laws."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from symmb._limits import MOST_STEPS_KEPT, require_steps
from symmb._magnitudes import SLIGHT
from symmb._types import Array
from symmb.declare.symbolic import common, t
from symmb.equations.model.system import System


@dataclass(frozen=True)
class Sampling:
    """Values that are computed at instants and held between them."""

    periods: tuple[float, ...]  # [s]
    states: tuple[tuple[int, int], ...]  # indices of two states: the value, and the number of its instants so far
    laws: tuple[ca.Function, ...]  # (q, v, s, p, t) -> the value
    begin: float = 0.0  # the first instant [s]

    def held(self, q: ca.SX, v: ca.SX, s: ca.SX, p: ca.SX, time: ca.SX) -> ca.SX:
        """States s (n_s,), with new values if an instant is reached at this time. Each instant acts once."""
        s = ca.SX(s)
        for period, (value, count), law in zip(self.periods, self.states, self.laws, strict=True):
            # Rounding moves the ends of steps, so an instant is reached a little early.
            number = ca.floor((time - self.begin) / period + SLIGHT)
            is_due = number + 0.5 > s[count]  # solvers integrate the count with rounding
            new = law(q, v, s, p, self.begin + period * number)
            s[value] = ca.if_else(is_due, new, s[value])
            s[count] = ca.if_else(is_due, number + 1, s[count])
        return s

    def before(self, more: ca.SX) -> "Sampling":
        """A copy for a parameter vector with more symbols at its end, such as sides of switches."""
        laws = []
        for law in self.laws:
            q, v, s, p, time = law.sx_in()
            laws.append(ca.Function(law.name(), [q, v, s, ca.vertcat(p, more), time], law.call([q, v, s, p, time])))
        return replace(self, laws=tuple(laws))

    def instants(self, times: Array) -> Array:
        """The instants (k,) [s] after the first of the times (n_t,), up to and including the last time."""
        counts = [(T, *np.floor((times[[0, -1]] - self.begin) / T + SLIGHT)) for T in self.periods]
        require_steps("Sampled", sum(last - first for _, first, last in counts), MOST_STEPS_KEPT)
        instants = np.concatenate([self.begin + T * np.arange(first + 1, last + 1) for T, first, last in counts])
        return np.unique(np.asarray(instants, dtype=np.float64))

    def missed(self, times: Array) -> Array:
        """The instants (k,) [s] that are not among the times (n_t,), up to the last time."""
        instants = self.instants(times)
        behind = np.minimum(np.searchsorted(times, instants), len(times) - 1)
        nearest = np.minimum(np.abs(times[behind] - instants), np.abs(times[behind - 1] - instants))
        return instants[nearest > SLIGHT * min(self.periods)]


def sampling_of(system: System) -> Sampling | None:
    """The sampled values of a system; None for a system without sampled values."""
    sampled = system.collected.sampled
    if not sampled:
        return None
    numbers = {state.sx.element_hash(): k for k, state in enumerate(system.collected.states)}
    at = [system.q, system.v, system.s, system.p, t]
    return Sampling(
        periods=tuple(float(element.period) for element, _ in sampled),
        states=tuple(
            (numbers[value.sx.element_hash()], numbers[count.sx.element_hash()])
            for value, count in (element.symbols for element, _ in sampled)
        ),
        laws=tuple(common(f"sampled{k}", at, [law]) for k, (_, law) in enumerate(sampled)),
    )
