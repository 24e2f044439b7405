"""Warnings about a linearisation."""

from collections.abc import Iterator

import numpy as np

from symmb.equations.model import Scene, left_out
from symmb.run.linear.eigenvalues import eigenvalues
from symmb.run.linear.linear_equations import Blocks
from symmb.run.linear.steady import DOUBT, SteadyMotion
from symmb.run.verification import AttachedLoads, deformation_doubts

_NAMED = 3
"""Maximum number of frequencies in a sentence."""


def doubts_of(scene: Scene, motion: SteadyMotion, blocks: Blocks, loads: tuple[AttachedLoads, ...]) -> tuple[str, ...]:
    """Warnings about the linearisation of a motion. The last outputs in `blocks` are loads of flexible bodies."""
    point, formulation = motion.point, motion.equations.formulation
    dae, X = formulation.in_bodies(point.x[None], point.p)
    own = motion.doubts or ((DOUBT,) if _varies(scene, motion, blocks) else ())
    deformed = deformation_doubts(scene, dae, X, point.p, np.array([point.t])) if loads else ()
    forgotten = left_out(scene.system.elements)
    return (*forgotten, *own, *deformed, *_doubts_of_loads(loads, motion, blocks))


def _varies(scene: Scene, motion: SteadyMotion, blocks: Blocks) -> bool:
    """Whether nothing moves, but coefficients change with time, such as a stiffness that is a function of time."""
    point, end = motion.point, float(scene.times[-1])
    if motion.moves or end <= point.t:
        return False
    # Number of later times at which A is compared, and their distance divided by the horizon. These distances are not
    # multiples of a common period.
    for k in range(1, 22):
        A = motion.equations.blocks(point.x[None], point.p[None], point.t + (end - point.t) * (k * 0.6180339887 % 1)).A
        # Change of an entry of A, divided by the largest entry. Above this value, A is not constant.
        if np.abs(A - blocks.A).max(initial=0.0) > 1e-3 * np.abs(blocks.A).max(initial=0.0):
            return True
    return False


def _doubts_of_loads(some: tuple[AttachedLoads, ...], motion: SteadyMotion, blocks: Blocks) -> Iterator[str]:
    """For each flexible body, warnings about oscillations with frequencies that are too high.

    Modes neglect a part of the compliance of the body. The loads of an oscillation cause the strain energy e in this
    part. By Rayleigh's quotient, the true frequency is lower by the factor (1 + e / V)^(-1/2), with the potential
    energy V of the oscillation.
    """
    if not some:
        return
    dae, point = motion.equations.dae, motion.point
    x = np.split(point.x, [dae.n_q, dae.n_q + dae.n_v])[: 2 + bool(dae.n_s)]
    eigen, M = eigenvalues(motion.A), dae.M(*x, point.p, point.t).full()
    states = motion.lift @ eigen.vectors[:, eigen.oscillating]
    moved, w = states[dae.n_v : 2 * dae.n_v], blocks.C[0][-sum(6 * len(loads.nodes) for loads in some) :] @ states
    potential = np.maximum(np.real(np.einsum("vk,vw,wk->k", moved.conj(), M, moved)), 1e-300)  # twice the kinetic one
    rates, at = np.abs(eigen.values[eigen.oscillating]), 0
    if not len(rates):
        return
    for loads in some:
        own, at = w[at : at + 6 * len(loads.nodes)], at + 6 * len(loads.nodes)
        if loads.responses is None:
            continue
        share = np.real(np.einsum("vk,vw,wk->k", own.conj(), loads.responses.energy, own)) / potential
        high = np.sqrt(1 + np.maximum(share, 0.0)) - 1
        # Frequency, divided by the highest frequency of the modes of a body. Below it, frequencies should be right.
        promised = rates <= 0.5 * np.sqrt(loads.body.modes.stiffness.max())
        # Maximum number of checked oscillations, from the lowest frequency on. Few users need higher frequencies.
        promised[0], promised[6:] = True, False
        # Largest relative error of a frequency. With this error, 10 % of the deflections are missing.
        if (wrong := np.flatnonzero((high > 0.05) & promised)).size:
            listed = ", ".join(f"{rates[k] / (2 * np.pi):.4g} Hz by {high[k]:.0%}" for k in wrong[:_NAMED])
            yield (
                f"FlexibleBody {loads.body.name!r}: its modes do not represent deflections by loads at its nodes "
                f"{', '.join(map(str, loads.loaded))}, so that frequencies are too high: {listed}"
                f"{', ...' * (len(wrong) > _NAMED)}. {loads.remedy}"
            )
