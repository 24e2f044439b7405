"""The end of a run as the start of a scene."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.model.system import System
from symmb.symbolic import t


@runtime_checkable
class EndedRun(Protocol):
    """What a restart reads of a run: scene, parameters, times (n_t,), and states (n_t, n_x) with their names."""

    @property
    def scene(self) -> Any: ...

    @property
    def parameters(self) -> dict[str, float]: ...

    @property
    def t(self) -> Array: ...

    @property
    def x(self) -> Array: ...

    @property
    def state_names(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]: ...


@dataclass(frozen=True, eq=False)
class Restart:
    """The state from which a scene goes on.

    Attributes
    ----------
    time : float           end of the run [s]
    first_instant : float  of sampled values, the start of the first of several runs [s]
    q, v, s : arrays       coordinates (n_q,), velocities (n_v,) and first-order states of the system (n_s,)
    drift : dict           name -> value of coordinates and velocities that nothing touches
    """

    time: float
    first_instant: float
    q: Array
    v: Array
    s: Array
    drift: dict[str, float]


def restart_of(system: System, run: object) -> Restart:
    """The end of a run as the start of a system.

    Raises
    ------
    DeclarationError       if it is no run, if it is of another system, or if its last state is not finite
    """
    where = "Scene.starting_at"
    if not isinstance(run, EndedRun):
        raise DeclarationError(f"{where}: expected a run of simulate, got {type(run).__name__}.")
    if run.scene is None:
        raise DeclarationError(f"{where}: the run was read from a file. Give Trajectory.load the scene.")
    c = system.collected
    names, wanted = run.state_names, [state.name for state in c.states]
    decoupled = [
        [name for x, _, vx, _ in part.decoupled for name in (x, vx)] for part in (run.scene.system.collected, c)
    ]
    of_run = [*names[0], *names[1], *decoupled[0], *run.parameters]
    of_scene = [*c.q_names, *c.v_names, *decoupled[1], *system.parameters]
    if of_run != of_scene:
        odd = [*(n for n in of_scene if n not in of_run), *(n for n in of_run if n not in of_scene)]
        what = f"only one of them has {odd[0]!r}" if odd else "the order of their bodies or parameters differs"
        raise DeclarationError(f"{where}: the run is of another system, {what}. Give a run of this scene.")
    missing = [name for name in wanted if name not in names[2]]
    if missing:
        raise DeclarationError(
            f"{where}: the run has no state {missing[0]!r}. Run the scene with the same elements, and with the outputs "
            "that need the state."
        )
    end = np.asarray(run.x, dtype=float)[-1]
    if not np.isfinite(end).all():
        raise DeclarationError(f"{where}: the run has failed, its last state is not finite.")
    q, v, s = np.split(end, [len(names[0]), len(names[0]) + len(names[1])])
    before = run.scene.restart
    return Restart(
        time=float(run.t[-1]),
        first_instant=float(run.t[0]) if before is None else before.first_instant,
        q=q,
        v=v,
        s=np.array([s[names[2].index(name)] for name in wanted]),
        drift=_drift(run),
    )


def _untouched(system: System) -> list[str]:
    """Names of the coordinates that nothing touches, and of their velocities."""
    return [name for x, _, vx, _ in system.collected.decoupled for name in (x, vx)]


def _drift(run: EndedRun) -> dict[str, float]:
    """Coordinates that nothing touches, and their velocities, at the end of a run."""
    scene, parts = run.scene, run.scene.system.collected.decoupled
    if not parts:
        return {}
    values = ca.vertcat(*[scene.expression(symbol) for _, x, _, vx in parts for symbol in (x, vx)])
    at_end = ca.Function("drift", [scene.system.p, t], [values])(list(run.parameters.values()), run.t[-1])
    return dict(zip(_untouched(scene.system), at_end.full().ravel().tolist(), strict=True))
