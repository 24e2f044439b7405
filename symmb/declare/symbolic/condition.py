"""Conditions as margins: expressions that change their sign if a condition becomes true or false."""

from dataclasses import dataclass

import casadi as ca

from symmb._errors import DeclarationError


@dataclass(frozen=True)
class Margin:
    """A condition as an expression. The expression is 0 or negative if the condition holds."""

    value: ca.SX
    is_strict: bool  # whether equality does not satisfy the condition


def margin_of(condition: ca.SX) -> Margin:
    """The margin of a comparison, or of comparisons that `logic_and`, `logic_or` and `logic_not` combine.

    Raises DeclarationError if the expression is not a comparison, is constant, or requires equality. A motion satisfies
    an equality only for an instant.
    """
    fault = f"the condition is not a comparison, or is constant. {EXAMPLE}"
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
        raise DeclarationError(
            "the condition requires equality, but a motion satisfies an equality only for an instant. Write <= or >=."
        )
    raise DeclarationError(fault)


EXAMPLE = "Compare expressions, as in ball.y <= 0."
