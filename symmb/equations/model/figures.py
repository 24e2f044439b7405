"""Scalar outputs of a scene, as expressions in the symbols of the scene."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import casadi as ca

from symmb._errors import DeclarationError, faults_of
from symmb._types import Array, Expr
from symmb.declare.mechanics import Figure
from symmb.declare.symbolic import margin_of, t


@dataclass(frozen=True, eq=False)
class BoundFigure:
    """A scalar output of a scene."""

    kind: str  # the name of the function that declared it
    expression: ca.SX | None  # None for a time
    margin: ca.SX | None  # zero or negative if the condition holds; None without a condition
    is_strict: bool  # whether the condition excludes equality
    window: tuple[float, float]  # first and last time of the window [s]
    per_second: float = 1.0  # number of units of time per second
    level: float | None = None  # fraction of a percentile
    over_runs: bool = False  # whether the level is a fraction of runs

    @property
    def parts(self) -> tuple[ca.SX, ...]:
        """The expressions over time that the scalar output needs."""
        return tuple(part for part in (self.expression, self.margin) if part is not None)


def bound_figure(figure: Figure, what: str, bind: Callable[[Expr, str], ca.SX], times: Array) -> BoundFigure:
    """The scalar output for the times (n_t,) of a scene."""
    expression = margin = None
    is_strict = False
    if figure.expression is not None:
        expression = bind(figure.expression, what)
        if expression.numel() != 1:
            raise DeclarationError(f"{what} has {expression.numel()} components. Give each component its own name.")
    if figure.condition is not None:
        bound = bind(figure.condition, what)
        with faults_of(what):
            condition = margin_of(bound)
        margin, is_strict = condition.value, condition.is_strict
    begin, end = float(times[0]), float(times[-1])
    if begin == end:
        raise DeclarationError(f"{what}: scalar outputs require a scene with at least two times.")
    low, high = figure.window or (None, None)
    window = begin if low is None else float(low), end if high is None else float(high)
    if not begin <= window[0] < window[1] <= end:
        raise DeclarationError(
            f"{what}: the window from {window[0]:g} to {window[1]:g} s is not inside the run from {begin:g} "
            f"to {end:g} s."
        )
    if figure.kind == "psd" and expression is not None:  # the real and the imaginary part of a Fourier transform
        phase = (t - window[0]) / (window[1] - window[0])
        weight = expression * (1 - ca.cos(2 * ca.pi * phase)) * ca.sqrt(4 * (window[1] - window[0]) / 3)
        turn = 2 * ca.pi * cast(float, figure.level) * t
        expression, margin = weight * ca.cos(turn), weight * ca.sin(turn)
    return BoundFigure(
        figure.kind, expression, margin, is_strict, window, level=figure.level, over_runs=figure.over_runs
    )
