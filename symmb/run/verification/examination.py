"""The examination of a run: drift of constraints and energy, singular positions, and warnings."""

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from symmb._types import Array, Mask
from symmb.declare.symbolic import batch
from symmb.equations.model import DAE
from symmb.equations.start import Singularity
from symmb.run.formulations import Formulation, Program
from symmb.run.integrate import CVODES, Run, refined
from symmb.run.verification.two_ways import ROUNDING, TwoWays, changes_of_outputs

_MOST, _LEAST, _WORK = 10_000, 100, 2e9
"""Largest and smallest number of examined times. Between these, the number of times is `_WORK` divided by the third
power of the number of velocities, which takes seconds."""
_AGAIN = CVODES(rtol=1e-8, stiff=True)
"""The solver of second runs between the examined times. It compiles nothing, and stiff motions do not slow it down."""
_FURTHER = 0.0, 10_000.0
"""Limit of the steps of such a run beyond one call. A run that resolves fast oscillations would take seconds."""
_SMALL, _USUAL, _SINGULAR = 1e-6, 2e3, 1e2
"""Smallest drift of energy that causes a warning; this drift divided by the relative tolerance; and the same quotient
near singular positions. Regular motions drift by up to 1,000 tolerances with multistep methods, and wrong branches by
300 or more. Calibrated by tests/test_problems.py"""


class Drift(NamedTuple):
    """Largest violation of all position rows (n_t,) and of all velocity rows (n_t,), in the units of the rows."""

    position: Array
    velocity: Array

    def __repr__(self) -> str:
        return f"Drift(position at most {self.position.max():.1e}, velocity at most {self.velocity.max():.1e})"


class Energy(NamedTuple):
    """Kinetic energy (n_t,), potential energy (n_t,), and work (n_t,) of forces without potential, at all times [J]."""

    kinetic: Array
    potential: Array
    work: Array

    def __repr__(self) -> str:
        ranges = (f"{name} {values.min():.4g} ... {values.max():.4g} J" for name, values in self._asdict().items())
        return f"Energy({', '.join(ranges)})"


@dataclass(frozen=True, eq=False)
class Examination:
    """States of a run at times over its horizon, for checks. The times do not depend on the output times.

    Attributes
    ----------
    t, x, work : (m,), (m, n_x), (m,)    times [s], states (nan after a failure), and work since the start [J]
    is_close : bool                      whether the times are close together
    """

    program: Program
    p: Array
    t: Array
    x: Array
    work: Array
    is_close: bool

    @classmethod
    def of(cls, program: Program, p: Array, t: Array, x: Array, work: Array, is_close: bool = False) -> "Examination":
        """The examination of a run with states x (m, n_x) and work (m,), at all times t (m,) or at some of them."""
        known = _known(x)
        end = len(known) - 1 if known.all() else int(known.argmin())  # the first time after a failure
        number = min(_number(program.bodies.dae), end + 1)
        some = np.unique(np.append(np.linspace(0, end, number).astype(np.intp), max(end - 1, 0)))
        if len(some) < len(t):
            t, x, work = t[some], x[some], work[some]
        return cls(program, p, t, x, work, is_close)

    @cached_property
    def drift(self) -> Drift:
        """Violation of the constraints at the examined times."""
        return drift(self.program.bodies, self.x, self.p, self.t)

    @cached_property
    def violation(self) -> Array:
        """Largest violations (m,) of position rows [-]. Each violation is divided by the change of its row by
        displacements of the size of the scene."""
        dae, bodies = self.program.bodies.start.dae, self.program.bodies.judged
        if dae.Phi is None or dae.G is None:
            return np.zeros(len(self.t))
        at = _at(dae, self.x, self.p, self.t)
        G = dae.G(*(part[0] for part in at[:-2]), self.p, self.t[0]).full()[: dae.n_c]
        changes = np.abs(G * bodies.displacement_scales).max(axis=1)
        return np.abs(batch(dae.Phi, *at)[0] / np.where(changes > 0, changes, bodies.scales.length)).max(axis=1)

    @cached_property
    def switch_values(self) -> Array:
        """Values (m, k) of the switches, which change their sign at kinks and jumps of the equations."""
        kinks = self.program.bodies.kinks(self.program.times)
        return np.empty((len(self.t), 0)) if kinks is None else kinks.values(self.x, self.p, self.t)

    @cached_property
    def _energy(self) -> Energy:
        return energy(self.program.bodies, self.x, self.p, self.t, self.work)

    @cached_property
    def energy_drift(self) -> float:
        """Largest drift of energy |T + V - W - E_0|, divided by the largest kinetic energy; nan if nothing moves."""
        change, largest = _change(self._energy), float(self._energy.kinetic.max(initial=0.0))
        # Drift of energy divided by the largest kinetic energy at the examined times. Above this value, a second run
        # looks for larger kinetic energies between these times.
        if change > 1e-6 * largest > 0 and not self.is_close:  # the motion may be at rest at all these times
            t, x = self._again
            T, *_ = energy(self.program.bodies, x, self.p, t, np.zeros(len(t)))
            largest = max(largest, float(np.nanmax(T, initial=0.0)))
        scales = self.program.bodies.judged.scales
        # Kinetic energy over that of a motion of the scene's size. Below this value, all speeds are rounding errors.
        return change / largest if largest > 1e-20 * scales.energy * scales.rate**2 else math.nan

    @cached_property
    def singularity(self) -> Singularity | None:
        """The singular position to which the run comes closest; None if the run is not close to any."""
        near = self.program.bodies.singularity(self.x, self.t, self.p)
        if near or self.program.bodies.dae.G is None or self.program.bodies.dae.impacts is not None:
            return near
        if np.isnan(self.x[-1]).any():
            return self._at_failure()
        if not self.is_close and self._is_unexplained(self.energy_drift):
            t, x = self._again
            return self.program.bodies.singularity(x, t, self.p)
        return None

    @property
    def fault(self) -> str:
        """A text with the time and the possible causes if the run leaves its constraints; otherwise empty."""
        # Violation of positions, divided by the size of the scene. Above this value, the positions cannot be reached.
        left = ~(self.violation <= 1e-2)
        if not left.any():
            return ""
        cause = "drives contradict each other, jump within a step, or require positions that cannot be reached"
        return (
            f"the run leaves its constraints at t = {self.t[int(left.argmax())]:g} s, by "
            f"{self.violation.max():.0e} of the size of the scene: "
            f"{'steps are too long, ' if self._rtol is None else ''}{cause}"
        )

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about drifts. The energy also drifts at singular positions, because branches of motion meet there.

        Velocities that a drive prescribes may jump. Fixed steps follow such a jump, but miss its work. In this case the
        drift of energy causes no warning.
        """
        position, energy = float(self.violation.max(initial=0.0)), self.energy_drift
        is_singular = self.singularity is not None
        if not is_singular and self._is_unexplained(energy):
            energy *= not self._falls_with_tolerance()
        if self._is_unexplained(position):
            return (
                f"The run violates its constraints by {position:.0e} of the scene's size: constraints contradict each "
                "other, or a position is nearly singular.",
            )
        # Drift of energy in fixed steps. Above this value, the motion changes visibly.
        if self._rtol is None and energy > 0.01 and self.program.bodies.dae.Phi_t is None:
            return (
                f"The energy drifts by {energy:.0%}: the steps are too long, or they damp the motion. Use shorter "
                "steps.",
            )
        if not self._is_unexplained(energy, _SINGULAR if is_singular else _USUAL):
            return ()
        drift = f"The energy drifts by {energy:.0e}, which is more than rtol = {self._rtol:g} explains."
        if is_singular:
            return (f"{drift} The run may have taken a wrong branch: try stabilization=AugmentedLagrangian().",)
        return (f"{drift} Try a smaller rtol.",)

    @property
    def _rtol(self) -> float | None:
        return getattr(self.program.solver, "rtol", None)

    def _is_unexplained(self, drift: float, usual: float = _USUAL) -> bool:
        """Whether the tolerance does not explain a relative drift, because it is too large; False without tolerance."""
        return self._rtol is not None and drift > max(_SMALL, usual * self._rtol)

    def _falls_with_tolerance(self) -> bool:
        """Whether a run at a tenth of the tolerance has a much smaller change of energy, and the same outputs.

        This is true if balanced forces do much work: the change of energy then falls to the rounding of the work. On a
        wrong branch, the change does not fall.
        """
        # Relative error of the work at the smallest tolerances: CVODES reaches 2e-10, and smaller tolerances do not
        # help.
        if _change(self._energy) <= 1e-9 * float(np.abs(self._energy.work).max()):
            return True
        (dae, y), p, t = (self.program.bodies.dae, self.program.bodies.y), self.p, self.t
        work = dae.power is not None or dae.impacts is not None
        run = self.program.solver.tighter().integration(dae, t, work=work).run(self.x[:1], p[None])[0]
        if run.message:
            return False
        # Factor by which a drift of energy falls at a tenth of the tolerance, if the tolerance causes the drift. Most
        # solvers reach 0.1.
        if _change(energy(self.program.bodies, run.X, p, t, work_of(run))) >= 0.5 * _change(self._energy):
            return False
        values, others = (batch(y, x, p, t[:, None])[0].reshape(len(t), -1) for x in (self.x, run.X))
        changes = partial(changes_of_outputs, y, dae, run.X, p, t)
        return not TwoWays(t, (), values, others, ("", ""), changes, (ROUNDING, ROUNDING)).lost.any()

    def _at_failure(self) -> Singularity | None:
        """The singular position at which a run fails. The run is repeated from its last state on the constraints."""
        dae, known = self.program.bodies.dae, _known(self.x)
        # Violation of positions, divided by the size of the scene. Below it, a state satisfies its constraints.
        sound = known & (self.drift.position <= 1e-6 * dae.scales.length)
        lost, k = int(known.argmin()), int(np.flatnonzero(sound).max(initial=0))
        begin, end, x = float(self.t[k]), float(self.t[lost]), self.x[k]
        # Number of examinations of a run that fails, each closer to the failure, and maximum number of times of each.
        for _ in range(2 if known[0] else 0):
            t = np.linspace(begin, end, min(2000, _number(dae)))
            X = _AGAIN.integration(dae, t).run(x[None], self.p[None])[0].X
            near, known = self.program.bodies.singularity(X, t, self.p), _known(X)
            if near or known.all():
                return near
            lost = int(known.argmin())
            begin, end, x = float(t[lost - 1]), float(t[lost]), X[lost - 1]
        return None

    @cached_property
    def _again(self) -> tuple[Array, Array]:
        """Times (m,) [s] and states (m, n_x) of a second run with more times; of the run itself if it has impacts."""
        dae = self.program.bodies.dae
        if dae.impacts is not None:
            return self.t, self.x
        t, _ = refined(self.t[[0, -1]])
        integration = dae.remembered(_AGAIN.integration, t, self.program.longest_step)
        return t, replace(integration, limit=_FURTHER).run(self.x[:1], self.p[None])[0].X


def drift(bodies: Formulation, x: Array, p: Array, t: Array) -> Drift:
    """Violation of the constraints in states x (m, n_x) at times t (m,) [s]."""
    dae, zero = bodies.start.dae, np.zeros(len(t))
    at = _at(dae, x, p, t)
    position = zero if dae.Phi is None else np.abs(batch(dae.Phi, *at)[0]).max(axis=1)
    velocity = zero if dae.Phi_dot is None else np.abs(batch(dae.Phi_dot, *at)[0]).max(axis=1)
    return Drift(position, velocity)


def energy(bodies: Formulation, x: Array, p: Array, t: Array, work: Array) -> Energy:
    """Energies in states x (m, n_x) at times t (m,) [s]."""
    T, V = batch(bodies.dae.energy, *_at(bodies.dae, x, p, t))
    return Energy(T[:, 0], V[:, 0], work)


def work_of(run: Run) -> Array:
    """Work along a run since its start (m,) [J]."""
    return run.quad[:, 0] if run.quad.shape[1] else np.zeros(len(run.X))


def _change(energy: Energy) -> float:
    """Largest |T + V - W - E_0| [J], or 0 if this is rounding of the energies."""
    balance = energy.kinetic + energy.potential - energy.work
    change = float(np.abs(balance - balance[0]).max(initial=0.0))
    # Change of energy, divided by the largest energy. Smaller changes are rounding errors.
    return change if change > 1e-14 * max(float(np.abs(some).max(initial=0.0)) for some in energy) else 0.0


def _at(dae: DAE, x: Array, p: Array, t: Array) -> tuple[Array, ...]:
    q, v, s = np.split(x, [dae.n_q, dae.n_q + dae.n_v], axis=1)
    return (q, v, *((s,) if dae.n_s else ()), p, t[:, None])


def _number(dae: DAE) -> int:
    return int(np.clip(_WORK / max(dae.n_v, 1) ** 3, _LEAST, _MOST))


def _known(x: Array) -> Mask:
    """Mask (m,) of the states (m, n_x) that are finite."""
    return np.atleast_1d(np.isfinite(x).all(axis=1))
