"""The DAE bundle for solvers: compiled functions, which unlike SX expressions can be pickled."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._options import require_instance
from symmb._types import Array
from symmb.model.c_export import example_c, save_c
from symmb.model.contact_equations import Contacts, Impacts
from symmb.model.redundancy import redundancy_equations
from symmb.model.sampling import Sampling, sampling_of
from symmb.model.scales import Scales
from symmb.model.system import System
from symmb.model.validation import require_inertia
from symmb.symbolic import t


def is_linear(name: str) -> bool:
    """Whether a coordinate or a velocity of this name is one of translation, or of a mode."""
    part = name.rpartition(".")[2]
    return part in _LINEAR or part.startswith("eta")


_LINEAR = ("x", "y", "z", "vx", "vy", "vz", "displacement", "displacement_rate")


@dataclass(frozen=True)
class DAE:
    """Compiled equations of motion of a system; see `system` for the notation.

    Every Function takes (q, v, p, t), or (q, v, s, p, t) if there are first-order states, unless said otherwise. A part
    that the scene does not have is None.

    Attributes
    ----------
    q_names, v_names, s_names, row_names, p_names : tuples of str
    rows : dict            constraint -> slice of its rows
    p_nominal : (n_p,)     nominal parameters
    q_neutral : (n_q,)     zeros and identity rotations
    rhs                    -> q', v' [, s']
    M, Q                   mass matrix (n_v, n_v), forces (n_v,)
    inertia                (..., a) -> M a, the forces that accelerations a (n_v,) need
    Phi, Phi_q, Phi_t      position rows (n_c,), Jacobian (n_c, n_q), partial rate (n_c,) with drives only
    Phi_dot, G, gamma      all rows' rates (n_r,), velocity Jacobian (n_r, n_v), right side of G v' = gamma (n_r,)
    forward                (..., gamma) -> v', lam: accelerations and multipliers for a given right side
    min_norm_correction  (..., r) -> delta (n_v,): least displacement in the norm of M with G delta = r
    energy                 -> T, V [J]
    power                  (..., lam) -> power of forces without potential and of drives [W]
    distribute_multipliers  (..., lam) -> multipliers of all rows of the system: the ones of
                           least norm with the same effect; only if rows are redundant
    vanishing              combinations of all rows, and of the position rows, that vanish wherever the constraints
                           hold, (n_r, k) and (n_c, k_c); only if redundant rows are not left out
    retract                (q, delta) -> q moved by delta
    assembly_cosines  (q, p) -> cosines of the joints, 1 in the intended assembly
    s_start                (q, p) -> start of the first-order states
    positive               p -> masses and lengths that must be above 0, named by `positive_names`
    impacts : Impacts      gaps that close, and velocities that jump then
    scales : Scales        of the motion; 1 if they are unknown
    s_rest : (n_s,)        states at the start next to which angles count their turns; None: 0
    sampling : Sampling    values that are held between instants
    """

    q_names: tuple[str, ...]
    v_names: tuple[str, ...]
    s_names: tuple[str, ...]
    row_names: tuple[str, ...]
    p_names: tuple[str, ...]
    rows: dict[str, slice]
    p_nominal: Array
    q_neutral: Array
    rhs: ca.Function
    inertia: ca.Function
    Q: ca.Function
    Phi: ca.Function | None
    Phi_q: ca.Function | None
    Phi_t: ca.Function | None
    Phi_dot: ca.Function | None
    G: ca.Function | None
    gamma: ca.Function | None
    forward: ca.Function
    min_norm_correction: ca.Function | None
    energy: ca.Function
    power: ca.Function | None
    distribute_multipliers: ca.Function | None
    vanishing: ca.Function | None
    retract: ca.Function
    assembly_cosines: ca.Function | None
    s_start: ca.Function | None
    positive: ca.Function
    positive_names: tuple[str, ...]
    impacts: Impacts | None = None
    scales: Scales = field(default_factory=Scales)
    s_rest: Array | None = None
    sampling: Sampling | None = None

    @cached_property
    def M(self) -> ca.Function:
        """Mass matrix (n_v, n_v). It is formed at its first use: that of a long chain in joint space is full."""
        names = self.inertia.name_in()
        *x, a = [ca.SX.sym(name, self.inertia.size1_in(i)) for i, name in enumerate(names)]
        return ca.Function("M", x, [ca.jacobian(self.inertia(*x, a), a)], names[:-1], ["M"])

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return len(self.q_names)

    @property
    def n_v(self) -> int:
        """Number of velocities."""
        return len(self.v_names)

    @cached_property
    def displacement_scales(self) -> Array:
        """Scales of displacements along v (n_v,) [m, rad]."""
        return self._sized(self.v_names)

    @cached_property
    def coordinate_scales(self) -> Array:
        """Scales of q (n_q,) [m, rad, -]."""
        return self._sized(self.q_names)

    @property
    def row_scales(self) -> Array:
        """Scales of the rows (n_r,)."""
        return np.ones(self.n_r) if self.scales.rows is None else self.scales.rows

    @property
    def state_sizes(self) -> Array:
        """Factors of the absolute tolerances of q, v and s (n_x,)."""
        n = self.n_q + self.n_v + self.n_s
        return np.full(n, self.scales.size) if self.scales.states is None else self.scales.states

    def _sized(self, names: Sequence[str]) -> Array:
        return np.array([self.scales.length if is_linear(name) else 1.0 for name in names])

    @property
    def n_s(self) -> int:
        """Number of first-order states."""
        return len(self.s_names)

    @property
    def n_c(self) -> int:
        """Number of position rows."""
        return 0 if self.Phi is None else self.Phi.numel_out(0)

    @property
    def n_r(self) -> int:
        """Number of rows in all, velocity-only ones included."""
        return len(self.row_names)

    @property
    def rank(self) -> int:
        """Rank of G wherever the constraints hold and no position is singular."""
        return self.n_r - (0 if self.vanishing is None else self.vanishing.size2_out(0))

    def arguments(self, x: ca.SX, p: ca.SX, time: ca.SX) -> tuple[ca.SX, ...]:
        """The state x = (q, v[, s]) split into the arguments of the Functions."""
        n = self.n_q + self.n_v
        return (x[: self.n_q], x[self.n_q : n], *((x[n:],) if self.n_s else ()), p, time)

    def save_c(self, folder: str | Path, start: Mapping[str, Array] | None = None) -> tuple[Path, ...]:
        """Write the Functions as C with a header and a small main program; needs nothing but a C compiler.

        With impacts and sampled values, the functions of their equations are written instead of the main program, which
        has no events.

        Parameters
        ----------
        folder : path                   it is created if it does not exist
        start : mapping, optional       "q" (n_q,), "v" (n_v,), "s" (n_s,), "p" (n_p,), "times" (n_t,): the main
                                        program integrates it; default: neutral coordinates at rest, nominal
                                        parameters, one second

        Returns
        -------
        tuple of Path                   the files written
        """
        exported = ("rhs", "M", "Q", "Phi", "Phi_q", "Phi_t", "gamma", "forward", "energy")
        functions = {name: f for name in exported if (f := getattr(self, name)) is not None}
        if self.impacts is not None:
            impacts = self.impacts
            functions |= {f.name(): f for f in (impacts.gaps, impacts.forces, impacts.impulses, impacts.project)}
        if self.sampling is not None:
            functions |= {f.name(): f for f in self.sampling.laws}
        if self.impacts is not None or self.sampling is not None:
            return save_c(functions, folder)
        begin = {"q": self.q_neutral, "v": np.zeros(self.n_v), "s": np.zeros(self.n_s), "p": self.p_nominal}
        require_instance("save_c: start", {} if start is None else start, Mapping, 'values such as {"q": [...]}')
        try:
            begin.update({name: np.asarray(values, dtype=float).ravel() for name, values in (start or {}).items()})
        except (TypeError, ValueError):
            raise DeclarationError(f"save_c: start must have numbers, got {start!r}.") from None
        times = np.asarray(begin.pop("times", (0.0, 1.0)))
        main = example_c(
            self.rhs,
            q=begin["q"],
            v=begin["v"],
            s=begin["s"],
            parameters=dict(zip(self.p_names, map(float, begin["p"]), strict=True)),
            coordinates=self.q_names,
            t0=float(times[0]),
            t1=float(times[-1]),
            steps=max(len(times) - 1, 100),
        )
        return save_c(functions, folder, example=main)


def compile_dae(system: System, rows: Sequence[int] | None = None, nullities: tuple[int, int] = (0, 0)) -> DAE:
    """Compile the equations of a system into CasADi Functions.

    Parameters
    ----------
    system : System
    rows : sequence of int, optional       numbers of the constraint rows to keep, where the others are redundant
    nullities : (int, int)                 combinations of these rows, and of the position rows among them, that vanish
                                           wherever the constraints hold

    Returns
    -------
    DAE

    Raises
    ------
    DeclarationError       if velocities have neither inertia nor a constraint

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=2.0, pose=mb.Particle())
    >>> dae = compile_dae(mb.System(ball, mb.Gravity(0, -9.81), mb.Force("push", ball.point(0, 0), (1, 0))))
    >>> dae.rhs([0, 0], [3, 4], [], 0.0)[1]
    DM([0.5, -9.81])
    """
    require_instance("compile_dae", system, System, "a System")
    reduced = system if rows is None else system.keeping(rows, nullities[0])
    a = ca.SX.sym("a", reduced.v.numel())
    require_inertia(ca.jacobian_sparsity(reduced.inertial(a), a), reduced.G, reduced.collected.v_names)
    c, (positive_names, positive) = reduced.collected, reduced.positive
    displacement = ca.SX.sym("delta", reduced.v.numel())
    moved = reduced.retract(displacement)
    retract = ca.Function("retract", [reduced.q, displacement], [moved], ["q", "delta"], ["q_new"])
    contacts = Contacts(reduced) if c.impacts else None
    redundant = {} if rows is None else redundancy_equations(system, reduced, nullities)
    functions = dict.fromkeys(_OPTIONAL) | _equations_of_motion(reduced, contacts, redundant)
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
        rows=c.rows,
        p_nominal=system.parameters.nominal,
        q_neutral=np.array([float(name.endswith(".e0")) for name in c.q_names]),
        retract=retract,
        positive=positive,
        positive_names=positive_names,
        impacts=None if contacts is None else contacts.compiled(retract),
        sampling=sampling_of(system),
        **functions,  # pyright: ignore[reportArgumentType]
    )


_OPTIONAL = ("Phi", "Phi_q", "Phi_t", "Phi_dot", "G", "gamma", "min_norm_correction", "power")
_OPTIONAL += ("distribute_multipliers", "vanishing")
"""Functions that only some scenes need."""


def _equations_of_motion(
    system: System, contacts: Contacts | None, redundant: dict[str, dict[str, ca.SX]]
) -> dict[str, ca.Function | None]:
    """The Functions of the states that the scene needs, by name, with those of redundant rows."""
    lam = ca.SX(system.lam)
    right = ca.SX.sym("gamma", lam.numel())
    a = ca.SX.sym("a", system.v.numel())
    solve = system.solve if contacts is None else contacts.solve
    vdot_free = system.accelerations if contacts is None else contacts.solve(system.Q, system.gamma)[0]
    vdot, multipliers = solve(system.Q, right) if right.numel() else (vdot_free, right)
    power = system.power if contacts is None else system.power + contacts.power
    outputs: dict[str, dict[str, ca.SX]] = {
        "rhs": {"qdot": system.qdot, "vdot": vdot_free, **({"sdot": system.s_rate} if system.s.numel() else {})},
        "inertia": {"Ma": ca.densify(system.inertial(a))},
        "Q": {"Q": system.Q},
        "forward": {"vdot": ca.densify(vdot), "lam": multipliers},
        "energy": {"T": system.kinetic_energy, "V": system.potential_energy},
        **redundant,
    }
    if system.Phi.numel():
        outputs |= {"Phi": {"Phi": system.Phi}, "Phi_q": {"Phi_q": system.Phi_q}}
    if "Phi_t" in system.parts:
        outputs["Phi_t"] = {"Phi_t": ca.densify(system.Phi_t)}
    if lam.numel():
        outputs |= {"Phi_dot": {"Phi_dot": system.Phi_dot}, "G": {"G": system.G}, "gamma": {"gamma": system.gamma}}
        delta, _ = system.solve(ca.SX(system.v.numel(), 1), right)
        outputs["min_norm_correction"] = {"delta": ca.densify(delta)}
    if ca.sparsify(power).nnz():
        outputs["power"] = {"power": power}
    states = [("q", system.q), ("v", system.v), *([("s", system.s)] if system.s.numel() else [])]
    more_inputs = {
        "inertia": ("a", a),
        "forward": ("gamma", right),
        "min_norm_correction": ("r", right),
        "power": ("lam", lam),
        "distribute_multipliers": ("lam_kept", lam),
    }
    return _functions([*states, ("p", system.p), ("t", t)], outputs, more_inputs)


def _functions(
    states: list[tuple[str, ca.SX]], outputs: dict[str, dict[str, ca.SX]], extra: dict[str, tuple[str, ca.SX]]
) -> dict[str, ca.Function | None]:
    """A Function of the states, and of additional inputs, for each dictionary of outputs.

    Common expressions are searched once for all of them: most share the factors of M.
    """
    reduced = iter(ca.cse([e for parts in outputs.values() for e in parts.values()]))
    functions: dict[str, ca.Function | None] = {}
    for name, parts in outputs.items():
        inputs = [*states, *([extra[name]] if name in extra else [])]
        values = [next(reduced) for _ in parts]
        functions[name] = ca.Function(name, [x for _, x in inputs], values, [n for n, _ in inputs], list(parts))
    return functions
