"""A restart: the last state of a run becomes the start state of a scene."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array
from symmb.declare.symbolic import t
from symmb.equations.model.system import System


@runtime_checkable
class EndedRun(Protocol):
    """The parts of a run for a restart: scene, parameters, times (n_t,), and states (n_t, n_x) with their names."""

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
    """The start state of a scene that continues a run."""

    time: float  # end of the run [s]
    first_instant: float  # first instant of sampled values: the start of the first run [s]
    q: Array  # (n_q,), coordinates
    v: Array  # (n_v,), velocities
    s: Array  # (n_s,), first-order states of the system
    drift: dict[str, float]  # coordinates and velocities on which no element acts


def restart_of(system: System, run: object) -> Restart:
    """The start state of a system from the last state of a run. The run must belong to the same system."""
    if not isinstance(run, EndedRun):
        raise DeclarationError(f"{_WHERE}: expected a run that simulate() returned, got {type(run).__name__}.")
    if run.scene is None:
        raise DeclarationError(
            f"{_WHERE}: the run was read from a file without its scene. Pass the scene: Trajectory.load(path, scene)."
        )
    _require_same_system(system, run)
    end = np.asarray(run.x, dtype=float)[-1]
    if not np.isfinite(end).all():
        raise DeclarationError(f"{_WHERE}: the run has failed. Its last state is not finite.")
    q_names, v_names, s_names = run.state_names
    q, v, s = np.split(end, [len(q_names), len(q_names) + len(v_names)])
    before = run.scene.restart
    return Restart(
        time=float(run.t[-1]),
        first_instant=float(run.t[0]) if before is None else before.first_instant,
        q=q,
        v=v,
        s=np.array([s[s_names.index(state.name)] for state in system.collected.states]),
        drift=_drift(run),
    )


_WHERE = "Scene.starting_at"


def _require_same_system(system: System, run: EndedRun) -> None:
    """Raise DeclarationError if a run has other coordinates or parameters, or if a state is missing in the run."""
    c, (q_names, v_names, s_names) = system.collected, run.state_names
    of_run = [*q_names, *v_names, *_untouched(run.scene.system), *run.parameters]
    of_scene = [*c.q_names, *c.v_names, *_untouched(system), *system.parameters]
    if of_run != of_scene:
        odd = [*(n for n in of_scene if n not in of_run), *(n for n in of_run if n not in of_scene)]
        what = f"only one of the systems has {odd[0]!r}" if odd else "the order of their bodies or parameters differs"
        raise DeclarationError(f"{_WHERE}: the run is of another system: {what}. Pass a run of this scene.")
    missing = [state.name for state in c.states if state.name not in s_names]
    if missing:
        raise DeclarationError(
            f"{_WHERE}: the run has no state {missing[0]!r}. Run a scene with the same elements and with the outputs "
            "that need this state."
        )


def _untouched(system: System) -> list[str]:
    """Names of the coordinates on which no element acts, and of their velocities."""
    return [name for x, _, vx, _ in system.collected.decoupled for name in (x, vx)]


def _drift(run: EndedRun) -> dict[str, float]:
    """Coordinates on which no element acts, and their velocities, at the end of a run."""
    scene, parts = run.scene, run.scene.system.collected.decoupled
    if not parts:
        return {}
    values = ca.vertcat(*[scene.expression(symbol) for _, x, _, vx in parts for symbol in (x, vx)])
    at_end = ca.Function("drift", [scene.system.p, t], [values])(list(run.parameters.values()), run.t[-1])
    return dict(zip(_untouched(scene.system), at_end.full().ravel().tolist(), strict=True))
