"""Warnings about flexible bodies: deformations beyond linear theory, and loads that the modes do not represent."""

from collections.abc import Iterator

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare import mechanics
from symmb.declare.mechanics import is_flexible
from symmb.declare.symbolic import batch
from symmb.equations.model import DAE, Scene
from symmb.run.formulations import output_function
from symmb.run.verification.missing_modes import AttachedLoads, along, attached_loads, left_out

TURN = 0.3
"""Largest rotation of a cross section relative to the frame of its body [rad] for linear theory. At this rotation, the
deflection of a cantilever under a load at its end is 4 % too large, and its shortening is 2 % of its length."""
_ROUNDING = 1e-9
"""Largest distance from an interval, divided by the width of the interval, that counts as a rounding error."""


def linear_theory_doubts(scene: Scene, dae: DAE, X: Array, p: Array, t: Array) -> tuple[str, ...]:
    """Warnings about flexible bodies in states X (m, n_x) of all bodies, with parameters p (n_p,), at times t (m,)."""
    known = np.isfinite(X).all(axis=1)
    X, t = X[known], t[known]
    some = attached_loads(scene) if len(t) else ()
    doubts = [*deformation_doubts(scene, dae, X, p, t)] if some else []
    for k, loads in enumerate(some):
        f = scene.remembered((_stretched, k), lambda: output_function(dae, scene, loads.wrenches, often=False))  # noqa: B023
        doubts += _stretched(loads, batch(f, X, p, t[:, None])[0].reshape(len(t), -1))
    for lack in left_out(scene, dae, some, X, p, t) if some else ():
        # Largest fraction of the effect of deformations on an output that modes may neglect.
        if lack.share > 0.08:
            doubts.append(
                f"FlexibleBody {lack.loads.body.name!r}: its modes neglect {lack.share:.0%} of the deflections by "
                f"loads at its nodes {', '.join(map(str, lack.loads.loaded))} (in their effect on {lack.output}), so "
                f"that the body is too stiff. {lack.loads.remedy}"
            )
    return tuple(doubts)


def deformation_doubts(scene: Scene, dae: DAE, X: Array, p: Array, t: Array) -> Iterator[str]:
    """Warnings about flexible bodies that bend or spin too much, or have modes for parameters other than p (n_p,)."""
    for k, body in enumerate(scene.system.bodies):
        if is_flexible(body) and (n := len(body.modes.stiffness)):
            moved = ca.vertcat(body.eta, body.frame.omega)
            f = scene.remembered((deformation_doubts, k), lambda: output_function(dae, scene, moved, often=False))  # noqa: B023
            eta, omega = np.split(batch(f, X, p, t[:, None])[0].reshape(len(t), -1), [n], axis=1)
            yield from (*_turned(body, eta, t), *_spun(body, omega, t), *_beyond(scene, body, p))


def _turned(body: "mechanics.FlexibleBody", eta: Array, t: Array) -> Iterator[str]:
    turn = body.modes.turns(eta)
    first, worst = t[int((turn > TURN).argmax())], t[int(turn.argmax())]
    if turn.max() > TURN:
        yield (
            f"FlexibleBody {body.name!r}: its cross sections turn by up to {turn.max():.2g} rad relative to its frame "
            f"(at t = {worst:.3g} s), and by more than {TURN:g} rad from t = {first:.3g} s on. Its modes are linear: "
            "deflections are too large, and bending does not shorten the body. Divide the body into several bodies."
        )


def _beyond(scene: Scene, body: "mechanics.FlexibleBody", p: Array) -> Iterator[str]:
    family, values = body.modes.family, dict(zip(scene.system.parameters, p.tolist(), strict=True))
    # Largest relative error of squared frequencies because of common mode shapes for a box of parameters.
    if family is not None and family.error > 0.01:
        yield (
            f"FlexibleBody {body.name!r}: its mode shapes are the same for all parameters of the box, so squared "
            f"frequencies have errors of up to {family.error:.1%}. Use narrower intervals in at=, or more modes."
        )
    for name, (low, high) in family.box.items() if family is not None else ():
        if not low - _ROUNDING * (high - low) <= values[name] <= high + _ROUNDING * (high - low):
            yield (
                f"FlexibleBody {body.name!r}: {name} = {values[name]:.6g} is outside of ({low:.6g}, {high:.6g}). Its "
                "modes were computed for this interval. Use a wider interval in at=."
            )


def _spun(body: "mechanics.FlexibleBody", omega: Array, t: Array) -> Iterator[str]:
    modes = body.modes
    J = modes.J0 - modes.mass * (modes.center @ modes.center * np.eye(3) - np.outer(modes.center, modes.center))
    # Spin about its axis stretches a slender body only little.
    rate = np.sqrt(np.einsum("ti,ij,tj->t", omega, J, omega) / np.linalg.eigvalsh(J)[-1])
    lowest, worst = float(np.sqrt(modes.stiffness.min())), t[int(rate.argmax())]
    extents = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(modes.positions.T)), 0.0))  # of the nodes, in rising order
    # Width over length. Below this value, a body without nodal rotations bends, and tension makes it stiffer.
    bends = modes.rotations.any() or extents[1] < 0.3 * extents[2]
    # Largest angular velocity, divided by the first frequency of a body without geometric stiffening. Above this value,
    # centrifugal forces change the frequency by more than 2 %. Southwell's coefficient of a cantilever is 1.2.
    if rate.max() > 0.2 * lowest and bends and not modes.is_stiffening:
        yield (
            f"FlexibleBody {body.name!r}: it turns at {rate.max():.3g} rad/s at t = {worst:.3g} s, which is "
            f"{rate.max() / lowest:.2g} times its first frequency of {lowest:.3g} rad/s. Centrifugal forces change its "
            "stiffness, but its modes ignore this. Use FiniteElements.modes(clamped=..., stiffening=True)."
        )


def _stretched(loads: AttachedLoads, w: Array) -> Iterator[str]:
    if loads.responses is None:
        return
    size = float(np.ptp(loads.body.modes.positions, axis=0).max())
    moved = np.abs((w - along(loads, w)) @ loads.responses.left.T).reshape(len(w), -1, 6)[:, :, :3].max(initial=0.0)
    # Displacement in a direction without modes, divided by the size of a body. Larger displacements cause a warning.
    if moved > 1e-3 * size:
        yield (
            f"FlexibleBody {loads.body.name!r}: its loads would stretch it by {moved:.2g} m in a direction without "
            f"modes. {loads.remedy}"
        )
