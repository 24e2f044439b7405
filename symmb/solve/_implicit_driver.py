"""Runs an implicit scheme: Newton's matrix from CasADi, steps side by side over the output times."""

import casadi as ca
import numpy as np

from symmb._types import Array
from symmb.schemes._step import Step
from symmb.solve._integration import Integration


def implicit_integration(step: Step, times: Array, length: float, tolerance: float) -> Integration:
    """A scheme compiled over the given times.

    Every interval between two output times is cut into equal steps no longer than `length`.

    Parameters
    ----------
    step : Step
    times : (n_t,) array      [s]
    length : float            longest step [s]
    tolerance : float         Newton stops at residuals or changes below this
    """
    guess = ca.Function("guess", [step.x, step.p, step.t], [ca.SX(0, 1)])
    if not step.x.numel() or len(times) == 1:
        return Integration(times, step.n_x, step.n_quad, None, None, guess)
    advance = _advance(step, tolerance)
    begin = ca.Function("begin", [step.x, step.p, step.t, step.h], [step.begin], {"cse": True})
    spans = np.diff(times)
    counts = np.maximum(np.ceil(spans / length - 1e-9).astype(int), 1)
    h = np.repeat(spans / counts, counts)
    ends = np.cumsum(counts) - 1
    t = times[0] + np.cumsum(h)
    x0, z0, p = (ca.MX.sym(n, size) for n, size in (("x0", step.n_x), ("z0", 0), ("p", step.p.numel())))
    w0 = begin(x0, p, times[0], h[0])
    W = advance.mapaccum(len(h))(w0, ca.repmat(p, 1, len(h)), t[None, :], h[None, :])[:, ends.tolist()]
    W = ca.horzcat(w0, W)
    names = ["x0", "z0", "p"], ["xf", "zf", "qf"]
    whole = ca.Function("whole", [x0, z0, p], _results(step, W), *names)

    count = int(counts.max())
    begin_t, span = ca.MX.sym("begin"), ca.MX.sym("span")
    w = begin(x0, p, begin_t, span / count)
    for_all = ca.repmat(p, 1, count), begin_t + span / count * ca.DM(np.arange(1, count + 1)).T, ca.repmat(span / count, 1, count)
    w = advance.mapaccum(count)(w, *for_all)[:, -1]
    between = ca.Function("between", [x0, z0, ca.vertcat(p, begin_t, span)], _results(step, w), *names)
    return Integration(times, step.n_x, step.n_quad, whole, between, guess)


def _advance(step: Step, tolerance: float) -> ca.Function:
    """(w, p, t, h) -> w at the end of the step."""
    arguments = [step.w, step.p, step.t, step.h]
    known = ca.vertcat(*arguments)
    newton = ca.rootfinder(
        "newton",
        "newton",
        {"x": step.z, "p": known, "g": step.residual},
        {"abstol": tolerance, "abstolStep": tolerance, "max_iter": 20, "linear_solver": "csparse", "error_on_fail": True},
    )
    guess = ca.Function("guess", arguments, [step.guess], {"cse": True})
    following = ca.Function("following", [step.z, *arguments], [ca.densify(step.following)], {"cse": True})
    symbols = [ca.MX.sym(s.name(), s.shape) if s.is_scalar() else ca.MX.sym("a", s.shape) for s in arguments]
    z = newton(guess(*symbols), ca.vertcat(*symbols))
    return ca.Function("advance", symbols, [following(z, *symbols)])


def _results(step: Step, W: ca.MX) -> list[ca.MX]:
    return [W[: step.n_x, :], ca.MX(0, W.shape[1]), W[step.n_x : step.n_x + step.n_quad, :]]
