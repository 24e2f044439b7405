"""Proved bounds in a comparison: they limit the reference, and check the other methods."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from symmb._types import Array
from symmb.bound.answers import Bounds
from symmb.study.metrics import Yardstick
from symmb.study.reference import Reference


@dataclass(frozen=True)
class ProvedBounds:
    """Proved bounds (n_t, n_y), infinite if nothing is proved, and the methods that prove them."""

    lower: Array
    upper: Array
    names: tuple[str, ...]

    @classmethod
    def of(cls, bounds: Sequence[Bounds]) -> "ProvedBounds | None":
        """The intersection of all enclosures among the bounds; None if there is no enclosure."""
        proved = [found for found in bounds if found.kind == "enclosure" and np.isfinite(found.upper).any()]
        if not proved:
            return None
        lower = np.max([found.lower for found in proved], axis=0)
        upper = np.min([found.upper for found in proved], axis=0)
        return cls(lower, upper, tuple(found.method for found in proved))

    def limit(self, reference: Reference, attained: bool) -> Reference:
        """The reference within the proved bounds.

        The true bounds are between the attained values and the proved bounds, except for the error of the solver. The
        distance between attained values and proved bounds is thus the largest error of the reference. If this distance
        is smaller than the uncertainty, the distance becomes the uncertainty.
        """
        lower, upper = (np.clip(a, self.lower, self.upper) for a in (reference.lower, reference.upper))
        limited = replace(reference, lower=lower, upper=upper)
        error = limited.yardstick.deviation(self.lower, self.upper)
        known = np.isfinite(error)
        if not (attained and known.any()):
            return limited
        error = np.where(known, error, np.nan)
        return replace(limited, uncertainty=np.fmin(reference.uncertainty, error), proved=error, proved_by=self.names)

    def is_refuted(self, attained: Reference, reference: Reference, solver_error: Array | None) -> bool:
        """Whether runs of the reference are outside of the proved bounds by more than the error of the solver."""
        slack = self._slack(reference.yardstick, solver_error)
        return bool((np.maximum(self.lower - attained.lower, attained.upper - self.upper) > slack).any())

    @staticmethod
    def _slack(yardstick: Yardstick, solver_error: Array | None) -> Array:
        """Accepted distance of runs outside of proved bounds. The error of the solver is known at a few points only."""
        error = np.zeros(len(yardstick.uncertainty)) if solver_error is None else 10.0 * solver_error
        return replace(yardstick, uncertainty=error).slack

    def faults(
        self, bounds: Sequence[Bounds], attained: Reference | None, yardstick: Yardstick, solver_error: Array | None
    ) -> list[str]:
        """Sentences about runs, and about bounds with their estimated error, that are outside of proved bounds.

        `attained` is the original reference, if its bounds are values of runs. `solver_error` (n_y,) is in
        the norm of `Score.error`.
        """
        slack = self._slack(yardstick, solver_error)
        farthest = partial(self._farthest, slack, bounds[0].t, bounds[0].names)
        by = " and ".join(self.names)
        runs, estimates = [], []
        if attained is not None:
            runs.append((f"the reference {attained.method}", attained.lower, attained.upper))
        for found in bounds:
            if found.inner is not None or found.kind == "sampled":
                runs.append((found.method, *(found.inner or (found.lower, found.upper))))
            if found.kind == "estimate" and found.estimate is not None:
                estimates.append((found.method, found.lower + found.estimate, found.upper - found.estimate))
        return [
            *(
                f"Runs of {name} are outside of the proved bounds of {by}: {where}. Either the solver is not exact "
                "enough there, or the runs or the proof are wrong. Try a solver with a smaller tolerance."
                for name, lower, upper in runs
                if (where := farthest(lower, upper))
            ),
            *(
                f"{name} underestimates its error. Its bounds are farther outside of the proved bounds of {by} than "
                f"its estimate: {where}."
                for name, lower, upper in estimates
                if (where := farthest(lower, upper))
            ),
        ]

    def _farthest(self, slack: Array, times: Array, outputs: Sequence[str], lower: Array, upper: Array) -> str:
        """Output, distance and time at which bounds are farthest outside; empty if no distance exceeds the slack."""
        outside = np.maximum(self.lower - lower, upper - self.upper)
        shares = np.where(outside > 0, outside, 0.0) / slack
        t, y = (int(i) for i in np.unravel_index(np.argmax(shares), shares.shape))
        if not shares[t, y] > 1.0:
            return ""
        return f"{outputs[y]} by {outside[t, y]:.1e} at t = {times[t]:g} s"
