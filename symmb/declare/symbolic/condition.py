"""Conditions as margins: expressions that change their sign where a condition begins or ends to hold."""

from dataclasses import dataclass

import casadi as ca

from symmb._errors import DeclarationError


@dataclass(frozen=True)
class Margin:
    """A condition as an expression that is not above 0 where it holds."""

    value: ca.SX
    is_strict: bool  # whether equality does not fulfil it


def margin_of(condition: ca.SX) -> Margin:
    """The margin of a comparison, or of several that `logic_and`, `logic_or` and `logic_not` join.

    DeclarationError if it is none, the same at all times, or asks for equality, which a motion passes in no time.
    """
    fault = f"the condition is no comparison, or the same at all times. {EXAMPLE}"
    if condition.numel() != 1 or condition.is_constant() or condition.is_symbolic():
        raise DeclarationError(fault)
    code = condition.op()
    if code in (ca.OP_LT, ca.OP_LE):
        return Margin(ca.densify(condition.dep(0) - condition.dep(1)), code == ca.OP_LT)
    if code == ca.OP_NOT:
        inner = margin_of(condition.dep(0))
        return Margin(-inner.value, not inner.is_strict)
    if code in (ca.OP_AND, ca.OP_OR):
        a, b = margin_of(condition.dep(0)), margin_of(condition.dep(1))
        both = ca.fmax if code == ca.OP_AND else ca.fmin
        return Margin(both(a.value, b.value), a.is_strict or b.is_strict)
    if code in (ca.OP_EQ, ca.OP_NE):
        raise DeclarationError("the condition asks for equality, which a motion passes in no time. Write <= or >=.")
    raise DeclarationError(fault)


EXAMPLE = "Compare expressions, as in ball.y <= 0."
