"""Scalar outputs: one number per run, such as a peak, a mean or the range at landing."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._options import is_finite_number, numbers_of, shown
from symmb._types import Expr
from symmb.declare.symbolic import EXAMPLE, is_sympy

Window = tuple[float | None, float | None] | None
"""First and last time [s]. None means the start or the end of the run."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A scalar output of a Scene: one number per run. Declare scalar outputs by `maximum`, `minimum`, `final`, `mean`,
    `rms`, `percentile`, `psd`, `first_time`, `value_at` and `probability`.

    Attributes
    ----------
    kind : str            the name of the function that declared the output
    expression : SX       expression over time; None for `first_time`
    condition : SX        comparison; None without a comparison
    window : (2,)         first and last time [s]; None for the start and the end of the run
    level : float         fraction of a `percentile`, or frequency of a `psd` [Hz]
    over_runs : bool      whether the level is a fraction of the runs of a random input, not of the time
    """

    kind: Literal[
        "maximum", "minimum", "final", "mean", "rms", "percentile", "psd", "first_time", "value_at", "probability"
    ]
    expression: Expr | None = None
    condition: Expr | None = None
    window: Window = None
    level: float | None = None
    over_runs: bool = False

    def __post_init__(self) -> None:
        fault = self._fault_of_expressions() or self._fault_of_window() or self._fault_of_level()
        if fault:
            raise DeclarationError(f"{self.kind}: {fault}")

    def _fault_of_expressions(self) -> str:
        parts = self.expression, self.condition
        if any(isinstance(part, Figure) for part in parts):
            return "expected an expression over time, got a scalar output. Use the expression itself."
        if self.kind in ("first_time", "value_at", "probability") and self.condition is None:
            return f"the condition is missing. {EXAMPLE}"
        if self.kind not in ("first_time", "probability") and self.expression is None:
            return "the expression is missing. Pass an expression, such as ball.y."
        for part in parts:
            if part is not None and not _is_expression(part):
                return f"expected an expression over time, got {shown(part)}."
        if isinstance(self.expression, bool | np.bool_):
            return f"expected an expression over time, got {self.expression}."
        if isinstance(self.condition, bool | np.bool_):
            return f"the condition is {self.condition} at all times. {EXAMPLE}"
        return ""

    def _fault_of_window(self) -> str:
        window = self.window
        if window is None:
            return ""
        ends = tuple(window) if isinstance(window, tuple | list) else ()
        if len(ends) != 2 or not all(end is None or is_finite_number(end) for end in ends):
            return f"window must be a pair of times, such as (0.5, 2.0) [s], got {shown(window)}."
        begin, end = ends
        crosses = begin is not None and end is not None and not begin < end
        return f"the window {shown(window)} must end after its start. Use increasing times." if crosses else ""

    def _fault_of_level(self) -> str:
        if self.kind == "psd" and not (is_finite_number(self.level) and self.level > 0):
            return f"the frequency must be a positive number [Hz], got {shown(self.level)}."
        if (self.kind == "percentile" or self.over_runs) and not (is_finite_number(self.level) and 0 < self.level < 1):
            return f"the fraction must be between 0 and 1, such as 0.95, got {shown(self.level)}."
        return ""

    def _refuse(self, *_: object) -> Any:
        raise DeclarationError(
            f"{self.kind}: a scalar output is one number per run, so expressions over time cannot contain it. Compute "
            "with the results of runs instead."
        )

    __neg__ = __abs__ = __float__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __pow__ = __rpow__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse

    def __repr__(self) -> str:
        parts = [str(part) for part in (self.expression, self.condition) if part is not None]
        return f"{self.kind}({', '.join([*parts, *([f'window={self.window}'] if self.window else [])])})"


def _is_expression(part: object) -> bool:
    """Whether a value is a scalar number or a symbolic expression."""
    if isinstance(part, bool | np.bool_ | ca.SX | ca.DM) or is_sympy(part):
        return True
    number = numbers_of(part)
    return number is not None and number.size == 1 and bool(np.isfinite(number).all())


def maximum(expression: Expr, window: Window = None) -> Figure:
    """The highest value of an expression over a run, including values between output times.

    If the expression jumps, such as a velocity at an impact, the values before and after the jump both count.

    Parameters
    ----------
    expression : SX
        expression of coordinates, velocities, multipliers, parameters and `t`
    window : (2,)
        first and last time [s] of the window; None for the start and the end of the run

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(speed=2.0)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> system = mb.System(ball, mb.Gravity(0, -9.81), parameters=p)
    >>> outputs = {"height": mb.maximum(ball.y)}
    >>> throw = mb.Scene(system, {"ball.vy": p.speed}, [0.0, 1.0], outputs, mb.Box(speed=(1.9, 2.1)))
    >>> round(mb.simulate(throw)["height"], 6)
    0.203874
    """
    return Figure("maximum", expression, window=window)


def minimum(expression: Expr, window: Window = None) -> Figure:
    """The lowest value of an expression over a run, including values between output times. See `maximum`.

    Examples
    --------
    >>> import symmb as mb
    >>> empty = mb.Scene(mb.System(), times=[0.0, 1.0], outputs={"lowest": mb.minimum((mb.t - 0.3) ** 2 + 2)})
    >>> round(mb.simulate(empty)["lowest"], 9)
    2.0
    """
    return Figure("minimum", expression, window=window)


def final(expression: Expr, window: Window = None) -> Figure:
    """The value of an expression at the end of a run, or of a window of time.

    Examples
    --------
    >>> import symmb as mb
    >>> empty = mb.Scene(mb.System(), times=[0.0, 3.0], outputs={"end": mb.final(mb.t**2)})
    >>> mb.simulate(empty)["end"]
    9.0
    """
    return Figure("final", expression, window=window)


def mean(expression: Expr, window: Window = None) -> Figure:
    """The mean of an expression over time: its integral over the run or the window, divided by the duration.

    Examples
    --------
    >>> import symmb as mb
    >>> empty = mb.Scene(mb.System(), times=[0.0, 3.0], outputs={"mean": mb.mean(mb.t**2)})
    >>> round(mb.simulate(empty)["mean"], 9)
    3.0
    """
    return Figure("mean", expression, window=window)


def rms(expression: Expr, window: Window = None) -> Figure:
    """The root mean square of an expression over time. With random inputs, it is the root of the mean over all runs.

    A vehicle at rest needs some seconds until its motion on a rough road is stationary. A window excludes these
    seconds.

    Examples
    --------
    >>> import symmb as mb
    >>> empty = mb.Scene(mb.System(), times=[0.0, 3.0], outputs={"rms": mb.rms(mb.t)})
    >>> round(mb.simulate(empty)["rms"] ** 2, 9)
    3.0
    """
    return Figure("rms", expression, window=window)


def percentile(output: Expr | Figure, fraction: float, window: Window = None) -> Figure:
    """The value that an expression does not exceed during a fraction of the time.

    With random inputs, it is a fraction of the time of all runs. The percentile of a scalar output, such as a
    `maximum`, is the value that the output does not exceed in a fraction of the runs. In a single run, it is the output
    itself.

    Parameters
    ----------
    output : SX or Figure
        expression of coordinates, velocities, multipliers, parameters and `t`; or a scalar output, which has its own
        window
    fraction : float
        between 0 and 1, such as 0.95
    window : (2,)
        first and last time [s] of the window; None for the start and the end of the run

    Examples
    --------
    >>> import symmb as mb
    >>> empty = mb.Scene(mb.System(), times=[0.0, 3.0], outputs={"p95": mb.percentile(mb.t**2, 0.95)})
    >>> round(mb.simulate(empty)["p95"], 2)  # (0.95 * 3)**2
    8.12
    """
    if isinstance(output, Figure):
        if window is not None or output.kind in ("percentile", "psd", "probability") or output.over_runs:
            raise DeclarationError(f"percentile: {output.kind} has no percentile with these arguments.")
        return replace(output, level=fraction, over_runs=True)
    return Figure("percentile", output, window=window, level=fraction)


def psd(expression: Expr, frequency: float, window: Window = None) -> Figure:
    """The one-sided power spectral density of an expression at a frequency, with Hann's window over time.

    The resolution is 1.5 divided by the length of the window. With random inputs, it is the mean over all runs. Its
    error is 1 % for a window of 10 periods of the frequency, and 4 % for 20 periods. Longer windows resolve the waves
    of the input.

    Parameters
    ----------
    expression : SX
        expression of coordinates, velocities, multipliers, parameters and `t`
    frequency : float
        frequency [Hz]
    window : (2,)
        first and last time [s] of the window; None for the start and the end of the run

    Returns
    -------
    Figure
        density [square of the unit of the expression, divided by Hz]

    Examples
    --------
    >>> import casadi as ca
    >>> import symmb as mb
    >>> tone = mb.psd(ca.cos(8 * ca.pi * mb.t), 4.0)
    >>> round(mb.simulate(mb.Scene(mb.System(), times=[0.0, 3.0], outputs={"tone": tone}))["tone"], 6)
    1.0
    """
    return Figure("psd", expression, window=window, level=frequency)


def first_time(condition: Expr, window: Window = None) -> Figure:
    """The first time [s] at which a condition holds.

    Equality for an instant is sufficient: the condition `gap <= 0` holds at an impact. If the condition holds at the
    start of the window, the result is the start. If both sides of a `<` are equal at the start, the result is the start
    only if the condition holds immediately after the start.

    Parameters
    ----------
    condition : SX
        comparison of expressions, or several comparisons joined by `casadi.logic_and` and `logic_or`. If the condition
        never holds, a single run gives nan and a warning. In a study, the upper bound is then infinite
    window : (2,)
        first and last time [s] of the window; None for the start and the end of the run

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> outputs = {"landing": mb.first_time(ball.y <= 0)}
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), {"ball.y": 1.0}, [0.0, 1.0], outputs)
    >>> round(mb.simulate(fall)["landing"], 6)
    0.451524
    """
    return Figure("first_time", condition=condition, window=window)


def value_at(expression: Expr, condition: Expr, window: Window = None) -> Figure:
    """The value of an expression when a condition holds for the first time, such as the range at landing.

    If the expression jumps at this time, the result is the value before the jump. If the condition never holds, a
    single run gives nan and a warning. A study bounds the value in the runs in which the condition holds.

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> outputs = {"range": mb.value_at(ball.x, ball.y <= 0)}
    >>> start = {"ball.y": 1.0, "ball.vx": 2.0}
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), start, [0.0, 1.0], outputs)
    >>> round(mb.simulate(fall)["range"], 6)
    0.903047
    """
    return Figure("value_at", expression, condition, window)


def probability(condition: Expr, window: Window = None) -> Figure:
    """The fraction of the runs of a random input in which a condition holds at least once. A single run gives 0 or 1.

    The fraction is smoothed by a Gaussian kernel over the extreme margins of the runs, so that it has no steps.

    Parameters
    ----------
    condition : SX
        comparison of expressions, as in `first_time`
    window : (2,)
        first and last time [s] of the window; None for the start and the end of the run

    Examples
    --------
    >>> import symmb as mb
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> outputs = {"hit": mb.probability(ball.y <= 0)}
    >>> fall = mb.Scene(mb.System(ball, mb.Gravity(0, -9.81)), {"ball.y": 1.0}, [0.0, 1.0], outputs)
    >>> mb.simulate(fall)["hit"]
    1.0
    """
    return Figure("probability", condition=condition, window=window)
