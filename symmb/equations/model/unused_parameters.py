"""Parameters without effect on a scene."""

from collections.abc import Iterable, Sequence

import casadi as ca

from symmb.equations.model.scene import Scene


def unused_parameters(scene: Scene, names: Iterable[str]) -> tuple[str, ...]:
    """The named parameters that appear in no equation, start value, guess or output of the scene."""
    used = scene.remembered(unused_parameters, lambda: _used(scene))
    return tuple(name for name in names if name not in used)


def with_some_outputs(scene: Scene, names: Sequence[str]) -> Scene:
    """A copy with some of the given outputs. Parameters that affect only the removed outputs still count as used."""
    outputs = scene.outputs or {}
    some = scene.with_outputs({name: outputs[name] for name in names})
    some.remembered(unused_parameters, lambda: scene.remembered(unused_parameters, lambda: _used(scene)))
    return some


def _used(scene: Scene) -> frozenset[str]:
    c, prescribed, guessed = scene.system.collected, scene.prescribed, scene.guessed
    expressions = [ca.vec(c.M), c.Q, c.potential, c.Phi, c.Psi, c.qdot, c.assembly_cosines, scene.curves.y]
    expressions += [value for _, value in c.positive]
    expressions += [part for state in c.states for part in (state.rate, state.value)]
    expressions += [law for _, law in c.sampled]
    expressions += [part for _, *law in c.impacts for part in law]
    expressions += [margin for _, margin in c.joint_events]
    for listed in (prescribed, guessed):
        for values in (listed.q, listed.v, listed.drift, listed.states):
            expressions += values.values()
        expressions += [value.value for value in listed.joints]
    symbols = {symbol.element_hash() for symbol in ca.symvar(ca.veccat(*expressions))}
    own = zip(scene.system.parameters, ca.vertsplit(scene.system.p), strict=True) if scene.system.parameters else ()
    return frozenset(name for name, symbol in own if symbol.element_hash() in symbols)
