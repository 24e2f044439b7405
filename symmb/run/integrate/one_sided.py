"""Equations of motion with the branches on one side of each switch of the state."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.declare.symbolic import Branches, On, batch, branches, common, has_kinks
from symmb.equations.model import DAE
from symmb.run.integrate.step_ends import hysteresis_of


@dataclass(frozen=True, eq=False)
class OneSided:
    """Smooth equations of motion, with the sides of the switches, 1 or -1, as last parameters.

    Attributes
    ----------
    dae : DAE
    switches                 (x, (p, sides), t) -> values (m,) of the switches, and their rates (m,)
    hysteresis : (m,)        changes of the values that are rounding errors
    """

    dae: DAE
    switches: ca.Function
    hysteresis: Array

    def on_sides(self, x: Array, p: Array, sides: Array, t: float) -> tuple[Array, Array]:
        """Values (m,) of the switches at one state x (n_x,), negative on the other side, and rates (m,) of these
        values."""
        at = x[: self.switches.numel_in(0)], np.concatenate([p, sides]), np.array([t])
        values, rates = (part[0] for part in batch(self.switches, *at))
        return values * sides, rates * sides

    def sides_at(self, x: Array, p: Array, t: float) -> Array:
        """The sides (m,) at one state x (n_x,). If a switch is 0, its rate gives the side."""
        sides = np.ones(len(self.hysteresis))
        # Maximum number of repetitions, because switches may depend on the sides of other switches.
        for _ in range(8):
            values, rates = self.on_sides(x, p, sides, t)
            signs = np.sign(np.where(np.abs(values) > self.hysteresis, values, rates)) * sides
            signs = np.where(signs == 0, sides, signs)
            if (signs == sides).all():
                break
            sides = signs
        return sides


def one_sided(dae: DAE) -> OneSided | None:
    """The one-sided equations of a DAE; None if they have no switches of the state."""
    if not has_kinks(dae.rhs):
        return None
    x, p, t = ca.SX.sym("x", dae.n_q + dae.n_v + dae.n_s), ca.SX.sym("p", len(dae.p_names)), ca.SX.sym("t")
    equations = _Equations(dae, x, p, t)
    branch = branches(equations.whole, [(x, On.STATE), (p, On.PARAMETERS), (t, On.TIME), (equations.more, On.STATE)])
    nonzeros = iter(branch.outputs)
    equations.change(lambda e: ca.SX(e.sparsity(), next(nonzeros)))
    rhs = ca.densify(ca.vertcat(*equations.outputs["rhs"]))
    used = _used(rhs, branch)
    if not used or ca.depends_on(branch.switches, equations.more):
        return None
    # Switches that do not change the rates, such as those of the power alone, are not switches of these equations.
    for k in sorted({*range(branch.sides.numel())}.difference(used), reverse=True):
        equations.change(ca.substitute, branch.sides[k], ca.if_else(branch.switches[k] < 0, -1, 1))
    sides, switches = branch.sides[used], branch.switches[used]
    with_sides = ca.vertcat(p, sides)
    rates = ca.densify(ca.jtimes(switches, x, rhs) + ca.jacobian(switches, t))
    return OneSided(
        replace(
            dae.with_functions(equations.functions(with_sides)),
            sampling=None if dae.sampling is None else dae.sampling.before(sides),
            p_names=(*dae.p_names, *(f"side {k}" for k in used)),
            p_nominal=np.concatenate([dae.p_nominal, np.ones(len(used))]),
        ),
        common("switches", [x, with_sides, t], [ca.densify(switches), rates]),
        np.array(hysteresis_of(dae, switches, x, p, t, sides)),
    )


class _Equations:
    """The functions of a DAE as expressions of common symbols. `more` are the symbols that the rates do not contain.

    `whole` is a Function of the expressions with kinks. The rates are the first of them.
    """

    def __init__(self, dae: DAE, x: ca.SX, p: ca.SX, t: ca.SX) -> None:
        self._functions = dae.functions
        self._symbols = dict(zip(dae.rhs.name_in(), dae.arguments(x, p, t), strict=True))
        for f in self._functions.values():
            for name in f.name_in():
                self._symbols.setdefault(name, ca.SX.sym(name, f.numel_in(name)))
        self.more = ca.vertcat(*list(self._symbols.values())[dae.rhs.n_in() :])
        self.outputs = {name: f.call([self._symbols[i] for i in f.name_in()]) for name, f in self._functions.items()}
        kinked = [name for name, f in self._functions.items() if has_kinks(f)]
        self._kinked = sorted(kinked, key=lambda name: name != "rhs")
        self.whole = common("whole", [x, p, t, self.more], [e for name in self._kinked for e in self.outputs[name]])

    def change(self, f: Callable[..., ca.SX], *arguments: ca.SX) -> None:
        """Replace each expression e with kinks by f(e, *arguments)."""
        self.outputs |= {name: [f(e, *arguments) for e in self.outputs[name]] for name in self._kinked}

    def functions(self, p: ca.SX) -> dict[str, ca.Function]:
        """The functions of the present expressions, with p as their parameters."""
        at = self._symbols | {"p": p}
        return {
            name: common(name, [at[i] for i in f.name_in()], self.outputs[name], f.name_in(), f.name_out())
            for name, f in self._functions.items()
        }


def _used(rhs: ca.SX, branch: Branches) -> list[int]:
    """Numbers of the sides on which the rates depend, directly or by other switches."""
    used: list[int] = []
    more = [k for k, side in enumerate(ca.vertsplit(branch.sides)) if ca.depends_on(rhs, side)]
    while more != used:
        used, switches = more, branch.switches[more]
        more = [k for k, side in enumerate(ca.vertsplit(branch.sides)) if k in used or ca.depends_on(switches, side)]
    return used
