"""The equations of motion for solvers, as compiled Functions. Unlike SX expressions, Functions can be pickled."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._interrupts import kept_interrupts
from symmb._options import require_instance, shown
from symmb._types import Array, Indices
from symmb.declare.symbolic import Branches
from symmb.equations import model
from symmb.equations.model.assembly import is_linear
from symmb.equations.model.lazy import Lazy, known
from symmb.equations.model.sampling import Sampling
from symmb.equations.model.scales import Scales

T = TypeVar("T")
NO_TIMES: Array = np.empty(0)


class Equation(Generic[T]):
    """Attribute for the Function in `DAE.equations` with the same name. Optional Functions may be None."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, dae: "DAE", owner: type) -> T:
        equation = dae.equations.get(self._name)
        return cast(T, None if equation is None else equation())


LAST_ENGINE = "last engine"
"""Key of `DAE.memory` for the last compiled engine."""


@dataclass(frozen=True)
class DAE:
    """Compiled equations of motion of a system; see `system` for the notation.

    Every Function takes (q, v, p, t), or (q, v, s, p, t) if there are first-order states, unless said otherwise. A part
    that the scene does not have is None. The Functions in `equations` and the scales are made at their first use,
    because a formulation of the scene uses only some of these Functions.
    """

    q_names: tuple[str, ...]
    v_names: tuple[str, ...]
    s_names: tuple[str, ...]
    row_names: tuple[str, ...]
    p_names: tuple[str, ...]
    p_units: Mapping[str, str]  # by name, without parameters that have no unit
    rows: dict[str, slice]  # rows of each constraint
    p_nominal: Array  # (n_p,), nominal parameters
    q_neutral: Array  # (n_q,), zeros and identity rotations
    Phi: ca.Function | None  # -> position rows (n_c,)
    Phi_dot: ca.Function | None  # -> rates of all rows (n_r,)
    G: ca.Function | None  # -> velocity Jacobian (n_r, n_v)
    equations: Mapping[str, Lazy[ca.Function]]
    retract: ca.Function  # (q, delta) -> q moved by delta
    assembly_cosines: ca.Function | None  # (q, p) -> cosines of the joints, 1 in the intended assembly
    s_start: ca.Function | None  # (q, p) -> start of the first-order states
    positive: ca.Function  # p -> masses and other numbers that must be above 0, named by `positive_names`
    positive_names: tuple[str, ...]
    impacts: "model.Impacts | None" = None  # gaps that close, and velocities that jump then
    measured: Lazy[Scales] = field(default_factory=lambda: known(Scales()))
    s_rest: Array | None = None  # (n_s,), states at the start of the count of turns of angles; None: zeros
    sampling: Sampling | None = None  # values that are held between instants
    nullities: tuple[int, int] = (0, 0)  # numbers of combinations of all rows and of position rows that vanish

    rhs = Equation[ca.Function]()  # -> q', v' [, s']
    inertia = Equation[ca.Function]()  # (..., a) -> M a, the forces that accelerations a (n_v,) need
    Q = Equation[ca.Function]()  # -> forces (n_v,)
    forward = Equation[ca.Function]()  # (..., gamma) -> v', lam: accelerations and multipliers for a given right side
    energy = Equation[ca.Function]()  # -> T, V [J]
    Phi_q = Equation[ca.Function | None]()  # -> Jacobian of the position rows (n_c, n_q)
    Phi_t = Equation[ca.Function | None]()  # -> partial time derivative of the position rows (n_c,), only with drives
    gamma = Equation[ca.Function | None]()  # -> right side of G v' = gamma (n_r,)
    s_rate = Equation[ca.Function]()  # -> s', as in `rhs`, without accelerations
    # (..., r) -> delta (n_v,), the displacement with G delta = r that is smallest in the norm of M
    min_norm_correction = Equation[ca.Function | None]()
    power = Equation[ca.Function | None]()  # (..., lam) -> power of forces without potential and of drives [W]
    # (..., lam) -> multipliers of all rows with the same effect and the smallest norm; only if rows are redundant
    distribute_multipliers = Equation[ca.Function | None]()
    # -> combinations (n_r, k) of all rows and (n_c, k_c) of the position rows that vanish wherever the constraints are
    # satisfied; only if redundant rows are not left out
    vanishing = Equation[ca.Function | None]()

    @property
    def functions(self) -> dict[str, ca.Function]:
        """The Functions of states, parameters and time that the scene has, by name."""
        rows = {"Phi": self.Phi, "Phi_dot": self.Phi_dot, "G": self.G}
        return {name: f() for name, f in self.equations.items()} | {k: f for k, f in rows.items() if f is not None}

    def with_functions(self, functions: Mapping[str, ca.Function]) -> "DAE":
        """A copy with other Functions of states, parameters and time."""
        rows = {name: functions.get(name) for name in ("Phi", "Phi_dot", "G")}
        return replace(self, equations={name: known(f) for name, f in functions.items() if name not in rows}, **rows)

    @cached_property
    def memory(self) -> dict[Any, Any]:
        """Results derived from the equations. The results are valid for all nominal parameters."""
        return {}

    def remembered(self, derive: Callable[["DAE", Array], T], times: Array = NO_TIMES, *more: float) -> T:
        """The result of `derive` for times (n_t,), computed once. `more` are numbers that depend on parameters."""
        key = derive, times.tobytes(), more
        if key not in self.memory:
            self.memory[key] = derive(self, times)
        return self.memory[key]

    def __getstate__(self) -> dict[str, Any]:
        # Branches contain symbols of a Function. A Function in another process has other symbols, so branches are
        # derived again. So are engines, because their sources are large.
        some = (key for key, value in self.memory.items() if key != LAST_ENGINE and not isinstance(value, Branches))
        memory = {key: self.memory[key] for key in some}
        return {**self.__dict__, "memory": memory}

    def around(self, p: Array) -> "DAE":
        """A copy for runs with parameters p (n_p,). The copy shares the derived results."""
        copy = replace(self, p_nominal=p)
        vars(copy)["memory"] = self.memory
        return copy

    @property
    def scales(self) -> Scales:
        """Typical sizes of the motion."""
        return self.measured()

    def scaled(self, measure: Callable[[], Scales]) -> "DAE":
        """A copy with other scales. The scales are measured at their first use."""
        return replace(self, measured=Lazy(measure))

    @cached_property
    def M(self) -> ca.Function:
        """Mass matrix (n_v, n_v), formed at its first use, because a long chain of joints has a full matrix."""
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
        """Number of all rows, including velocity-only rows."""
        return len(self.row_names)

    @property
    def lasting(self) -> Indices:
        """Indices (k,) of the constraint equations of joints that stay closed during the whole run."""
        gated = self.impacts.joints.names if self.impacts is not None and self.impacts.joints is not None else ()
        rows = [np.arange(at.start, at.stop) for name, at in self.rows.items() if name not in gated]
        return np.concatenate([np.arange(0), *rows])

    @property
    def rank(self) -> int:
        """Rank of G at nonsingular positions that satisfy the constraints."""
        return self.n_r - self.nullities[0]

    @property
    def position_rank(self) -> int:
        """Rank of the position rows at nonsingular positions that satisfy the constraints."""
        return self.n_c - self.nullities[self.n_c < self.n_r]

    def arguments(self, x: Any, p: Any, time: Any) -> tuple[ca.SX, ...]:
        """The state x = (q, v[, s]) split into the arguments of the Functions."""
        ends = [self.n_q, self.n_q + self.n_v]
        is_array = isinstance(x, np.ndarray)  # slices of CasADi matrices may be rows
        parts: Any = np.split(x, ends) if is_array else ca.vertsplit(x, [0, *ends, x.numel()])
        q, v, s = parts
        return (q, v, *((s,) if self.n_s else ()), p, time)

    @kept_interrupts()
    def save_c(self, folder: str | Path, start: Mapping[str, Array] | None = None) -> tuple[Path, ...]:
        """Write the Functions as C with a header and a small main program. The files need only a C compiler.

        The main program integrates from "q" (n_q,), "v" (n_v,), "s" (n_s,) and "p" (n_p,) in `start` over "times"
        (n_t,). The default run takes one second, from neutral coordinates at rest. For scenes with impacts or
        sampled values, only the Functions are written, without a main program. The method returns the paths of the
        files.
        """
        exported = ("rhs", "M", "Q", "Phi", "Phi_q", "Phi_t", "gamma", "forward", "energy")
        functions = {name: f for name in exported if (f := getattr(self, name)) is not None}
        if self.impacts is not None:
            impacts = self.impacts
            functions |= {f.name(): f for f in (impacts.gaps, impacts.forces, impacts.impulses, impacts.project)}
        if self.sampling is not None:
            functions |= {f.name(): f for f in self.sampling.laws}
        if self.impacts is not None or self.sampling is not None:
            return model.save_c(functions, folder)
        begin = {"q": self.q_neutral, "v": np.zeros(self.n_v), "s": np.zeros(self.n_s), "p": self.p_nominal}
        require_instance("save_c: start", {} if start is None else start, Mapping, 'values such as {"q": [...]}')
        try:
            begin.update({name: np.asarray(values, dtype=float).ravel() for name, values in (start or {}).items()})
        except (TypeError, ValueError):
            raise DeclarationError(f"save_c: the values in start must be numbers, got {shown(start)}.") from None
        times = np.asarray(begin.pop("times", (0.0, 1.0)))
        main = model.example_c(
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
        return model.save_c(functions, folder, example=main)
