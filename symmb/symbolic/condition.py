"""The margin of a condition: an expression that is below 0 where the condition holds."""

import casadi as ca

from symmb._errors import DeclarationError

_COMPARISONS = (ca.OP_LT, ca.OP_LE)


def margin(condition: ca.SX) -> ca.SX:
    """What is below 0 where a condition holds, and above 0 where it does not.

    Parameters
    ----------
    condition : scalar SX
        comparisons, also joined by `logic_and`, `logic_or`, `logic_not`; another expression holds where it is above 0

    Raises
    ------
    DeclarationError
        if it asks for equality, which a motion passes in no time
    """
    kind = condition.op() if condition.n_dep() else None
    if kind in _COMPARISONS:
        return condition.dep(0) - condition.dep(1)
    if kind == ca.OP_AND:
        return ca.fmax(margin(condition.dep(0)), margin(condition.dep(1)))
    if kind == ca.OP_OR:
        return ca.fmin(margin(condition.dep(0)), margin(condition.dep(1)))
    if kind == ca.OP_NOT:
        return -margin(condition.dep(0))
    if kind in (ca.OP_EQ, ca.OP_NE):
        raise DeclarationError(f"{condition} asks for equality, which a motion passes in no time. Write < or >.")
    return -condition
