"""Fixed steps over the output times in one compiled call, for explicit, collocation and implicit schemes."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from symmb._types import Array, Indices
from symmb.declare.symbolic import batch, common
from symmb.run.integrate.cells import interval_steps
from symmb.run.integrate.initial_value_problem import InitialValueProblem
from symmb.run.integrate.integration import Integration
from symmb.run.schemes import Step, Tableau


@dataclass(frozen=True)
class Advance:
    """One step of a scheme on its history w, which begins with the state x (n_x,) and the quadrature (n_quad,).

    begin (x, p, t, h) -> w     history at the start, before a first step of length h
    step (w, p, t, h) -> w      history after a step of length h that ends at t
    """

    begin: ca.Function
    step: ca.Function
    n_x: int
    n_quad: int


@dataclass(eq=False)
class _FixedSteps(Integration):
    """Runs with equal steps in each interval of the times. `counts` (n_t - 1,) are the numbers of steps."""

    scheme: Advance = field(kw_only=True)
    counts: Indices = field(kw_only=True)

    def march(self, x0: Array, p: Array) -> Iterator[tuple[int, Array]]:
        n_x, t = self.n_x, float(self.times[0])

        def projected(w: Array, time: float) -> Array:
            if self.project is None:
                return w
            return np.hstack([batch(self.project, w[:, :n_x], p, np.array([time]))[0], w[:, n_x:]])

        lengths = np.diff(self.times) / self.counts
        (w,) = batch(self.scheme.begin, x0, p, np.array([t]), lengths[:1])
        w = projected(w, t)
        yield 0, w[:, :n_x]
        for i, (h, count) in enumerate(zip(lengths, self.counts, strict=True), start=1):
            for _ in range(count):
                t += float(h)
                (w,) = batch(self.scheme.step, w, p, np.array([t]), np.array([h]))
            w = projected(w, t)
            yield i, w[:, :n_x]


def fixed_step_integration(
    advance: Advance, times: Array, length: float, project: ca.Function | None = None
) -> Integration:
    """The integration of a scheme over the given times.

    Every interval between two output times is divided into equal steps, which are not longer than `length`.

    Parameters
    ----------
    advance : Advance
    times : (n_t,) array        output times [s]
    length : float              longest step [s]
    project : (x, p, t) -> x    projection at every output time; only for schemes with a history that is the state alone
    """
    n_x, n_p = advance.n_x, advance.step.numel_in(1)
    guess = ca.Function("guess", [ca.SX.sym("x", n_x), ca.SX.sym("p", n_p), ca.SX.sym("t")], [ca.SX(0, 1)])
    if not n_x or len(times) == 1:
        return Integration(times, n_x, advance.n_quad, guess)
    counts = interval_steps(times, length)
    between = _interval(advance, int(counts.max()))
    if project is None:
        whole = _all_steps(advance, times, counts)
    else:
        # Intervals with equal numbers of steps are folded into one loop. Other intervals follow one by one.
        whole = _all_intervals(between, project, times) if counts.min() == counts.max() else None
    return _FixedSteps(times, n_x, advance.n_quad, guess, whole, between, project, scheme=advance, counts=counts)


def explicit_steps(problem: InitialValueProblem, tableau: Tableau) -> Advance:
    """One step of an explicit Runge-Kutta method."""
    n_x, n_quad = problem.x.numel(), problem.quad.numel()
    rates = common("rates", [problem.x, problem.p, problem.t], [problem.ode, problem.quad])
    w, h = ca.SX.sym("w", n_x + n_quad), ca.SX.sym("h")
    begin, slopes = problem.t - h, []
    for c, row in zip(tableau.C, tableau.A, strict=True):
        shift = sum((a * slopes[j][:n_x] for j, a in row.items()), ca.SX.zeros(n_x))
        slopes.append(ca.vertcat(*rates(w[:n_x] + h * shift, problem.p, begin + c * h)))
    new = w + h * sum((b * slopes[j] for j, b in tableau.B.items()), ca.SX.zeros(n_x + n_quad))
    step = common("step", [w, problem.p, problem.t, h], [new])
    return Advance(_start_at_rest(problem), step, n_x, n_quad)


def collocation(problem: InitialValueProblem, degree: int) -> Advance:
    """Radau collocation of the given degree: one step of CasADi's method for the problem with algebraic variables."""
    n_x, n_quad = problem.x.numel(), problem.quad.numel()
    begin, span, tau = ca.SX.sym("begin"), ca.SX.sym("span"), ca.SX.sym("tau")
    time = begin + span * tau
    dae = {"x": problem.x, "z": problem.z, "p": ca.vertcat(problem.p, begin, span), "t": tau}
    for name, rate, factor in (("ode", problem.ode, span), ("alg", problem.alg, 1), ("quad", problem.quad, span)):
        dae[name] = ca.substitute(rate, problem.t, time) * factor
    options = {
        "number_of_finite_elements": 1,
        "interpolation_order": degree,
        "collocation_scheme": "radau",
        # Newton's method converges quadratically: after a step of 1e-10, only rounding errors remain.
        "rootfinder_options": {"abstol": 1e-12, "abstolStep": 1e-10},
    }
    one = ca.integrator("one", "collocation", {k: e for k, e in dae.items() if e.numel()}, 0, 1, options)
    guess = common("guess", [problem.x, problem.p, problem.t], [problem.z_guess])
    w, p, t, h = (ca.MX.sym(n, k) for n, k in (("w", n_x + n_quad), ("p", problem.p.numel()), ("t", 1), ("h", 1)))
    x = w[:n_x]
    result = one(x0=x, z0=guess(x, p, t - h), p=ca.vertcat(p, t - h, h))
    new = ca.vertcat(result["xf"], w[n_x:] + result["qf"]) if n_quad else result["xf"]
    return Advance(_start_at_rest(problem), ca.Function("step", [w, p, t, h], [new]), n_x, n_quad)


def implicit_steps(scheme: Step) -> Advance:
    """One step of an implicit scheme. CasADi derives the matrix of Newton's method."""
    arguments = [scheme.w, scheme.p, scheme.t, scheme.h]
    begin = common("begin", [scheme.x, scheme.p, scheme.t, scheme.h], [scheme.begin])
    following = common("following", [scheme.z, *arguments], [ca.densify(scheme.following)])
    symbols = [ca.MX.sym(name, s.numel()) for name, s in zip("wpth", arguments, strict=True)]
    z = ca.MX(0, 1)
    if scheme.z.numel():
        newton = ca.rootfinder(
            "newton",
            "newton",
            {"x": scheme.z, "p": ca.vertcat(*arguments), "g": scheme.residual},
            {"abstol": 0.0, "abstolStep": 1e-12, "max_iter": 20, "linear_solver": "csparse"},
        )
        guess = common("guess", arguments, [scheme.guess])
        z = newton(guess(*symbols), ca.vertcat(*symbols))
    return Advance(begin, ca.Function("step", symbols, [following(z, *symbols)]), scheme.n_x, scheme.n_quad)


def _start_at_rest(problem: InitialValueProblem) -> ca.Function:
    """A history that contains only the state, and no integrals."""
    w = ca.vertcat(problem.x, ca.SX.zeros(problem.quad.numel()))
    return ca.Function("begin", [problem.x, problem.p, problem.t, ca.SX.sym("h")], [w])


def _symbols(advance: Advance) -> tuple[ca.MX, ca.MX, ca.MX]:
    return ca.MX.sym("x0", advance.n_x), ca.MX.sym("z0", 0), ca.MX.sym("p", advance.step.numel_in(1))


def _as_integrator(name: str, arguments: list[ca.MX], advance: Advance, W: ca.MX) -> ca.Function:
    """A function (x0, z0, p) -> (xf, zf, qf) with the interface of CasADi's integrators. W are the histories at the
    output times."""
    n_x, n_quad = advance.n_x, advance.n_quad
    results = [W[:n_x, :], ca.MX(0, W.shape[1]), W[n_x : n_x + n_quad, :]]
    return ca.Function(name, arguments, results, ["x0", "z0", "p"], ["xf", "zf", "qf"])


def _all_steps(advance: Advance, times: Array, counts: Indices) -> ca.Function:
    x0, z0, p = _symbols(advance)
    h = np.concatenate([np.full(n, span / n) for n, span in zip(counts, np.diff(times), strict=True)])
    ends = times[0] + np.cumsum(h)
    w0 = advance.begin(x0, p, times[0], h[0])
    W = advance.step.mapaccum(len(h))(w0, ca.repmat(p, 1, len(h)), ends[None, :], h[None, :])
    at_outputs = (np.cumsum(counts) - 1).tolist()
    return _as_integrator("whole", [x0, z0, p], advance, ca.horzcat(w0, W[:, at_outputs]))


def _interval(advance: Advance, count: int) -> ca.Function:
    x0, z0, _ = _symbols(advance)
    extended = ca.MX.sym("p", advance.step.numel_in(1) + 2)
    p, begin, span = extended[:-2], extended[-2], extended[-1]
    h = span / count
    ends = begin + h * ca.DM(np.arange(1.0, count + 1)).T
    W = advance.step.mapaccum(count)(
        advance.begin(x0, p, begin, h), ca.repmat(p, 1, count), ends, ca.repmat(h, 1, count)
    )
    return _as_integrator("between", [x0, z0, extended], advance, W[:, -1])


def _all_intervals(between: ca.Function, project: ca.Function, times: Array) -> ca.Function:
    n_x, n_quad, n_t = between.numel_out(0), between.numel_out(2), len(times)
    w, p, t, span = (
        ca.MX.sym(n, k) for n, k in (("w", n_x + n_quad), ("p", project.numel_in(1)), ("t", 1), ("span", 1))
    )
    x, _, quad = between(w[:n_x], ca.MX(0, 1), ca.vertcat(p, t - span, span))
    interval = ca.Function("interval", [w, p, t, span], [ca.vertcat(project(x, p, t), w[n_x:] + quad)])
    x0, z0 = ca.MX.sym("x0", n_x), ca.MX.sym("z0", 0)
    w0 = ca.vertcat(project(x0, p, times[0]), ca.MX.zeros(n_quad))
    spans = np.diff(times)
    W = ca.horzcat(w0, interval.mapaccum(n_t - 1)(w0, ca.repmat(p, 1, n_t - 1), times[None, 1:], spans[None, :]))
    results = [W[:n_x, :], ca.MX(0, n_t), W[n_x:, :]]
    return ca.Function("whole", [x0, z0, p], results, ["x0", "z0", "p"], ["xf", "zf", "qf"])
