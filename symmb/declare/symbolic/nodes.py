"""Replacement of nodes of expression graphs."""

from collections.abc import Mapping

import casadi as ca

from symmb.declare.symbolic.pieces import applied


def with_nodes(expression: ca.SX, replacements: Mapping[int, ca.SX]) -> ca.SX:
    """An expression in which nodes, given by their hashes, are replaced by scalars.

    Unlike `casadi.substitute`, this function replaces any subexpression, not only symbols.

    Examples
    --------
    >>> import casadi as ca
    >>> x, c = ca.SX.sym("x"), ca.SX.sym("c")
    >>> cosine = ca.cos(x)
    >>> with_nodes(cosine * x + cosine, {cosine.element_hash(): c})
    SX(((c*x)+c))
    """
    if not expression.nnz():
        return expression
    known: dict[int, ca.SX] = dict(replacements)
    roots = ca.vertsplit(expression.nz[:])
    for root in roots:
        pending = [root]
        while pending:
            node = pending[-1]
            key = node.element_hash()
            if key in known:
                pending.pop()
                continue
            parts = [node.dep(k) for k in range(node.n_dep())]
            missing = [part for part in parts if part.element_hash() not in known]
            if missing:
                pending += missing
                continue
            pending.pop()
            new = [known[part.element_hash()] for part in parts]
            if all(a.element_hash() == b.element_hash() for a, b in zip(new, parts, strict=True)):
                known[key] = node
            elif node.is_output():
                known[key] = new[0].get_output(node.which_output())
            elif node.is_call():
                known[key] = node.which_function()(*new)[0].dep(0)
            else:
                known[key] = applied(node.op(), *new)
    return ca.SX(expression.sparsity(), ca.vertcat(*[known[root.element_hash()] for root in roots]))
