"""The equations of contacts for the engine: gaps as switches of the state, forces, impulses and states in contact."""

from dataclasses import replace

import casadi as ca
import numpy as np

from symmb.codegen import Contacts, StepEnds
from symmb.events import ImpactLaws
from symmb.integrate.initial_value_problem import InitialValueProblem
from symmb.integrate.step_ends import SwitchedProblem
from symmb.model import DAE, Impacts


def contacts_of(dae: DAE, impacts: Impacts, with_work: bool) -> Contacts:
    """The data of the contacts of a DAE."""
    return Contacts(
        impacts.names,
        tuple((dae.n_q + dae.n_v + impacts.closed).tolist()),
        dae.n_q,
        dae.n_v,
        with_work,
        float(dae.scales.length),
        float(dae.scales.energy),
        tuple(dae.displacement_scales.tolist()),
        ImpactLaws(dae, impacts),
    )


def with_gaps(
    problem: InitialValueProblem, frozen: SwitchedProblem | None, dae: DAE, impacts: Impacts, work: bool
) -> SwitchedProblem:
    """A problem, perhaps with switches, whose last switches are the gaps of open contacts, and 1 for closed ones.

    It projects states into closed contacts as well. The work of impulses needs an integral along the motion.
    """
    frozen = frozen or SwitchedProblem(problem, ca.SX(0, 1), StepEnds())
    problem, n, m = frozen.problem, len(impacts.names), len(frozen.ends.hysteresis)
    x, p, t = problem.x, problem.p[: len(dae.p_names)], problem.t
    gap, rate = impacts.gaps(*dae.arguments(x, p, t))
    is_closed = x[(dae.n_q + dae.n_v + impacts.closed).tolist()] > 0.5
    gap, rate = ca.if_else(is_closed, 1, gap), ca.if_else(is_closed, 0, rate)
    projected = x if problem.projected is None else problem.projected
    parts = {"p": ca.vertcat(problem.p, ca.SX.sym("side", n)), "projected": _held(dae, impacts, projected, p, t)}
    parts["quad"] = problem.quad if problem.quad.numel() == work else ca.SX(1, 1)
    return SwitchedProblem(
        replace(problem, **parts),
        ca.densify(ca.vertcat(frozen.switches[:m], gap, frozen.switches[m:], rate)),
        replace(frozen.ends, hysteresis=(*frozen.ends.hysteresis, *np.zeros(n).tolist())),
    )


def contact_functions(dae: DAE, impacts: Impacts, x: ca.SX, p: ca.SX, t: ca.SX) -> dict[str, ca.SX]:
    """Gaps, forces, impulses and held states of c/impacts.h at states x, which may end with the work."""
    n_x, p = dae.n_q + dae.n_v + dae.n_s, p[: len(dae.p_names)]
    at = dae.arguments(x[:n_x], p, t)
    functions = {name: getattr(impacts, name)(*at) for name in ("gaps", "forces", "impulses")}
    parts = {name: ca.vertcat(*(ca.vec(ca.densify(e)) for e in values)) for name, values in functions.items()}
    return parts | {"held": ca.vertcat(_held(dae, impacts, x[:n_x], p, t), x[n_x:])}


def _held(dae: DAE, impacts: Impacts, x: ca.SX, p: ca.SX, t: ca.SX) -> ca.SX:
    """The state x (n_x,) in its closed contacts."""
    return ca.vertcat(*impacts.project(*dae.arguments(x, p, t)), x[dae.n_q + dae.n_v :])
