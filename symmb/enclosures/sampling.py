"""Values that are held between instants: changes of states at given times."""

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.enclosures.independent_velocities import Equations
from symmb.enclosures.problem import Change
from symmb.enclosures.rounding import U, fine_grain_of
from symmb.model import DAE
from symmb.symbolic import common

_TOGETHER = 1e-9
"""Instants that are closer than this share of a period are one."""


def sampled(dae: DAE, equations: Equations, times: Array) -> Change | None:
    """The changes of the values that are held, from one instant after the first time to the next."""
    sampling = dae.sampling
    assert sampling is not None
    instants, begin = sampling.instants(times), float(times[0])
    instants = instants[np.diff(instants, prepend=-np.inf) > _TOGETHER * min(sampling.periods)]
    grain = fine_grain_of(float(times[-1] - begin))
    late = grain + 4 * U * float(np.abs(times).max())

    def following(k: int) -> Change | None:
        """The change at an instant by its number."""
        if k == len(instants):
            return None
        x, p, t = (ca.SX.sym(name, equations.whole.numel_in(i)) for i, name in enumerate("xpt"))
        q, v, s, *_ = dae.arguments(equations.whole(x, p, t), p, t)
        for T, (value, count), law in zip(sampling.periods, sampling.states, sampling.laws, strict=True):
            number = round((instants[k] - sampling.begin) / T)
            own = sampling.begin + T * number
            if abs(own - instants[k]) <= _TOGETHER * T:
                s[value], s[count] = law(q, v, s, p, own), s[count] + 1
        states = common("states", [x, p, t], [ca.densify(ca.vertcat(x[: x.numel() - dae.n_s], s))])
        time = float(np.round((instants[k] - begin) / grain) * grain)
        return Change(time, states, lambda time, problem: problem.with_fields(change=following(k + 1)), late)

    return following(0)
