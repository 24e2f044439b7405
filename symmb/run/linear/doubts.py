"""What cannot be trusted about a linearisation."""

from collections.abc import Iterator

import numpy as np

from symmb.equations.model import Scene
from symmb.run.linear.eigenvalues import eigenvalues
from symmb.run.linear.linear_equations import Blocks
from symmb.run.linear.steady import DOUBT, SteadyMotion
from symmb.run.verification import AttachedLoads, deformation_doubts

_TIMES, _GOLDEN = 21, 0.6180339887
"""Later times at which A is compared, and the share of the horizon between them: they do not fall on whole periods."""
_CHANGE = 1e-3
"""Change of an entry of A, over its largest one, from which it is not constant."""
_TOO_HIGH = 0.05
"""Share of a frequency by which it may be too high: deflections then lack 10 %."""
_PROMISED = 0.5
"""Share of the highest frequency of a body's modes up to which oscillations should be right, beside the first one."""
_NAMED = 3
"""Frequencies that a sentence names."""
_MOST = 6
"""Oscillations that are judged, from the lowest frequency on: higher ones are asked for by few."""


def doubts_of(scene: Scene, motion: SteadyMotion, blocks: Blocks, loads: tuple[AttachedLoads, ...]) -> tuple[str, ...]:
    """Doubts about a scene that is linear next to a motion. The loads of its flexible bodies are the last outputs."""
    point, formulation = motion.point, motion.equations.formulation
    dae, X = formulation.in_bodies(point.x[None], point.p)
    own = motion.doubts or ((DOUBT,) if _varies(scene, motion, blocks) else ())
    deformed = deformation_doubts(scene, dae, X, point.p, np.array([point.t])) if loads else ()
    return (*own, *deformed, *_doubts_of_loads(loads, motion, blocks))


def _varies(scene: Scene, motion: SteadyMotion, blocks: Blocks) -> bool:
    """Whether coefficients of the equations change with time where nothing moves, as a stiffness that is a law of t."""
    point, end = motion.point, float(scene.times[-1])
    if motion.moves or end <= point.t:
        return False
    for k in range(1, _TIMES + 1):
        A = motion.equations.blocks(point.x[None], point.p[None], point.t + (end - point.t) * (k * _GOLDEN % 1)).A
        if np.abs(A - blocks.A).max(initial=0.0) > _CHANGE * np.abs(blocks.A).max(initial=0.0):
            return True
    return False


def _doubts_of_loads(some: tuple[AttachedLoads, ...], motion: SteadyMotion, blocks: Blocks) -> Iterator[str]:
    """Which oscillations about a motion are too fast, for each flexible body. Its loads are the last outputs.

    Modes leave out a compliance of their body. It has strain energy e under the loads of an oscillation, and the
    frequency falls by the factor (1 + e / V)^(-1/2), V the potential energy of the oscillation (Rayleigh's quotient).
    """
    if not some:
        return
    dae, point = motion.equations.dae, motion.point
    x = np.split(point.x, [dae.n_q, dae.n_q + dae.n_v])[: 2 + bool(dae.n_s)]
    eigen, M = eigenvalues(motion.A), dae.M(*x, point.p, point.t).full()
    states = motion.lift @ eigen.vectors[:, eigen.oscillating]
    moved, w = states[dae.n_v : 2 * dae.n_v], blocks.C[0][-sum(6 * len(loads.nodes) for loads in some) :] @ states
    potential = np.maximum(np.real(np.einsum("vk,vw,wk->k", moved.conj(), M, moved)), 1e-300)  # twice, as the kinetic
    rates, at = np.abs(eigen.values[eigen.oscillating]), 0
    if not len(rates):
        return
    for loads in some:
        own, at = w[at : at + 6 * len(loads.nodes)], at + 6 * len(loads.nodes)
        if loads.responses is None:
            continue
        share = np.real(np.einsum("vk,vw,wk->k", own.conj(), loads.responses.energy, own)) / potential
        high = np.sqrt(1 + np.maximum(share, 0.0)) - 1
        promised = rates <= _PROMISED * np.sqrt(loads.body.modes.stiffness.max())
        promised[0], promised[_MOST:] = True, False
        if (wrong := np.flatnonzero((high > _TOO_HIGH) & promised)).size:
            listed = ", ".join(f"{rates[k] / (2 * np.pi):.4g} Hz by {high[k]:.0%}" for k in wrong[:_NAMED])
            yield (
                f"FlexibleBody {loads.body.name!r}: its modes do not follow the loads at its nodes "
                f"{', '.join(map(str, loads.loaded))}, so that frequencies are too high: {listed}"
                f"{', ...' * (len(wrong) > _NAMED)}. {loads.remedy}"
            )
