"""When a run first meets a kink or a jump of its state."""

import numpy as np

from symmb._types import Array
from symmb.events import Kinks
from symmb.integrate import Integration, SwitchPasses
from symmb.simulation.formulation import Formulation


def first_kink(kinks: Kinks, form: Formulation, integration: Integration, p: Array, times: Array) -> float:
    """The time at which a run with parameters p (n_p,) first meets one of the kinks [s]; nan if it meets none."""
    x0, _ = form.start.states(p[None])
    X = integration.run(x0, p[None], 1)[0].X
    first = kinks.first(X[(ok := np.isfinite(X).all(axis=1))], p, times[ok])
    if form.dae.impacts is None:  # passes that cancel between two output times
        first = np.fmin(first, SwitchPasses(form.dae, times).first(x0, p[None]))
    return float(first)
