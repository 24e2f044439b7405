"""Compilation of the equations of a system. Functions that may not be needed are compiled at their first
use."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._options import require_instance, require_numbers, whole
from symmb._units import units_of_parameters
from symmb.declare.symbolic import least_multipliers, shared, t, vanishing_rows
from symmb.equations import model
from symmb.equations.model.dae import DAE
from symmb.equations.model.lazy import Lazy
from symmb.equations.model.sampling import sampling_of
from symmb.equations.model.system import System
from symmb.equations.model.validation import require_inertia

Outputs = Mapping[str, ca.SX]
"""Expressions of the outputs of a Function by name."""


@kept_interrupts()
def compile_dae(system: System, rows: Sequence[int] | None = None, nullities: tuple[int, int] = (0, 0)) -> DAE:
    """Compile the equations of a system into CasADi Functions.

    Parameters
    ----------
    system : System
        the inputs of the system become the last parameters
    rows : sequence of int, optional
        indices of the constraint rows to keep if the other rows are redundant
    nullities : (int, int)
        numbers of linear combinations that vanish at all positions that satisfy the constraints: combinations of all
        kept rows, and of the kept position rows

    Returns
    -------
    DAE

    Raises
    ------
    DeclarationError
        If a velocity has neither inertia nor a constraint

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=2.0, pose=mb.Particle())
    >>> dae = mb.compile_dae(mb.System(ball, mb.Gravity(0, -9.81), mb.Force("push", ball.point(0, 0), (1, 0))))
    >>> dae.rhs([0, 0], [3, 4], [], 0.0)[1]
    DM([0.5, -9.81])
    """
    require_instance("compile_dae", system, System, "a System")
    if rows is not None:
        indices = require_numbers("compile_dae", "rows", rows, None).tolist()
        for row in indices:
            if row not in range(len(system.collected.row_names)):
                raise DeclarationError(f"compile_dae: there is no constraint row {row:g}.")
        rows = sorted({int(row) for row in indices})  # CasADi crashes with indices that are not of type int
    require_numbers("compile_dae", "nullities", nullities, 2)
    of_rows, of_positions = (whole("compile_dae", "a nullity", n, 0) for n in nullities)
    nullities = of_rows, of_positions
    system = system.with_inputs
    reduced = system if rows is None else system.keeping(rows, nullities[0])
    a = ca.SX.sym("a", reduced.v.numel())
    require_inertia(ca.jacobian_sparsity(reduced.inertial(a), a), reduced.G, reduced.collected.v_names)
    c, (positive_names, positive) = reduced.collected, reduced.positive
    displacement = ca.SX.sym("delta", reduced.v.numel())
    moved = reduced.retract(displacement)
    retract = ca.Function("retract", [reduced.q, displacement], [moved], ["q", "delta"], ["q_new"])
    contacts = model.ContactEquations(reduced) if c.impacts or c.joint_events else None
    functions: dict[str, ca.Function | None] = dict.fromkeys(("Phi", "Phi_dot", "G"))
    functions |= _functions(reduced, _rows(reduced))
    for name, values in (
        ("assembly_cosines", c.assembly_cosines),
        ("s_start", ca.vertcat(*[state.value for state in c.states])),
    ):
        functions[name] = ca.Function(name, [reduced.q, reduced.p], [values]) if values.numel() else None
    return DAE(
        q_names=c.q_names,
        v_names=c.v_names,
        s_names=tuple(state.name for state in c.states),
        row_names=c.row_names,
        p_names=tuple(system.parameters),
        p_units=units_of_parameters(system.parameters),
        rows=c.rows,
        p_nominal=system.parameters.nominal,
        q_neutral=np.array([float(name.endswith(".e0")) for name in c.q_names]),
        equations=_equations(reduced, contacts, None if rows is None else (system, nullities)),
        retract=retract,
        positive=positive,
        positive_names=positive_names,
        impacts=None if contacts is None else contacts.compiled(retract),
        s_rest=np.array([s.resting for s in c.states]) if c.joint_events else None,
        sampling=sampling_of(system),
        nullities=(0, 0) if rows is None else nullities,
        **functions,  # pyright: ignore[reportArgumentType]
    )


def _rows(system: System) -> dict[str, Outputs]:
    """The outputs that every start needs: constraint rows, their rates and their Jacobian."""
    rows: dict[str, Outputs] = {}
    if system.Phi.numel():
        rows["Phi"] = {"Phi": system.Phi}
    if system.lam.numel():
        rows |= {"Phi_dot": {"Phi_dot": system.Phi_dot}, "G": {"G": system.G}}
    return rows


def _equations(
    system: System, contacts: "model.ContactEquations | None", whole: tuple[System, tuple[int, int]] | None
) -> dict[str, Lazy[ca.Function]]:
    """The Functions of the equations of motion of the scene, by name.

    `whole` is a pair: the system with its redundant rows, and the numbers of vanishing combinations of rows.
    """
    a, lam = ca.SX.sym("a", system.v.numel()), ca.SX(system.lam)
    right = ca.SX.sym("gamma", lam.numel())
    power = system.power if contacts is None else system.power + contacts.power

    def solutions() -> dict[str, Outputs]:
        solve = system.solve if contacts is None else contacts.solve
        vdot_free = system.accelerations if contacts is None else contacts.solve(system.Q, system.gamma)[0]
        vdot, multipliers = solve(system.Q, right) if right.numel() else (vdot_free, right)
        outputs: dict[str, Outputs] = {
            "rhs": {"qdot": system.qdot, "vdot": vdot_free, **({"sdot": system.s_rate} if system.s.numel() else {})},
            "forward": {"vdot": ca.densify(vdot), "lam": multipliers},
        }
        if right.numel():
            delta, _ = system.solve(ca.SX(system.v.numel(), 1), right)
            outputs["min_norm_correction"] = {"delta": ca.densify(delta)}
        if whole is not None:
            lam_kept = system.G.T @ ca.SX(system.lam)
            every = least_multipliers(whole[0].G, lam_kept, whole[0].collected.units)
            outputs["distribute_multipliers"] = {"lam": every}
        return outputs

    inputs = {
        "inertia": ("a", a),
        "forward": ("gamma", right),
        "min_norm_correction": ("r", right),
        "power": ("lam", lam),
        "distribute_multipliers": ("lam_kept", lam),
    }
    solved = Lazy(lambda: _functions(system, solutions(), inputs))

    def one_of(functions: Lazy[dict[str, ca.Function]], name: str) -> Lazy[ca.Function]:
        return Lazy(lambda: functions()[name])

    def alone(name: str, outputs: Callable[[], Outputs]) -> Lazy[ca.Function]:
        return one_of(Lazy(lambda: _functions(system, {name: outputs()}, inputs)), name)

    def forward() -> Outputs:
        return {"vdot": ca.densify(solutions()["rhs"]["vdot"]), "lam": right}

    equations = {
        "rhs": one_of(solved, "rhs"),
        "forward": one_of(solved, "forward") if right.numel() else alone("forward", forward),
        "inertia": alone("inertia", lambda: {"Ma": ca.densify(system.inertial(a))}),
        "Q": alone("Q", lambda: {"Q": system.Q}),
        "s_rate": alone("s_rate", lambda: {"sdot": system.s_rate}),
        "energy": alone("energy", lambda: {"T": system.kinetic_energy, "V": system.potential_energy}),
    }
    if system.Phi.numel():
        equations["Phi_q"] = alone("Phi_q", lambda: {"Phi_q": system.Phi_q})
    if "Phi_t" in system.parts:
        equations["Phi_t"] = alone("Phi_t", lambda: {"Phi_t": ca.densify(system.Phi_t)})
    if lam.numel():
        equations["gamma"] = alone("gamma", lambda: {"gamma": system.gamma})
        equations["min_norm_correction"] = one_of(solved, "min_norm_correction")
    if ca.sparsify(power).nnz():
        equations["power"] = alone("power", lambda: {"power": power})
    if whole is not None:
        equations["distribute_multipliers"] = one_of(solved, "distribute_multipliers")
        if any(whole[1]):
            equations["vanishing"] = alone("vanishing", lambda: _vanishing(system, whole[1]))
    return equations


def _vanishing(system: System, nullities: tuple[int, int]) -> Outputs:
    """Combinations of the rows, and of the position rows, that vanish wherever the constraints are satisfied."""
    n_c, usual = system.Phi.numel(), 1 / system.collected.units
    N = N_c = vanishing_rows(system.G, nullities[0], usual)
    if system.Psi.numel():
        N_c = vanishing_rows(system.G[:n_c, :], nullities[1], usual[:n_c])
    return {"of_all": N, "of_positions": N_c}


def _functions(
    system: System, outputs: Mapping[str, Outputs], inputs: Mapping[str, tuple[str, ca.SX]] = MappingProxyType({})
) -> dict[str, ca.Function]:
    """A Function of the states and of additional inputs for each dictionary of outputs.

    Common subexpressions are searched once for all Functions, because most Functions have some in common.
    """
    states = [("q", system.q), ("v", system.v), *([("s", system.s)] if system.s.numel() else [])]
    states += [("p", system.p), ("t", t)]
    expressions = [e for parts in outputs.values() for e in parts.values()]
    reduced = iter(shared(expressions) if expressions else ())
    functions: dict[str, ca.Function] = {}
    for name, parts in outputs.items():
        own = [*states, *([inputs[name]] if name in inputs else [])]
        values = [next(reduced) for _ in parts]
        arguments = [x for _, x in own]
        try:
            functions[name] = ca.Function(name, arguments, values, [n for n, _ in own], list(parts))
        except RuntimeError:
            free = ca.Function(name, arguments, values, {"allow_free": True}).free_sx()
            raise DeclarationError(
                f"The equations contain {free}. No parameter and no body of the System has this symbol."
            ) from None
    return functions
