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
    changed = {key for key, new in known.items() if new.element_hash() != key}
    roots = ca.vertsplit(expression.nz[:])
    for root in roots:
        pending = [_opened(root)]
        while pending:
            node, key, parts, keys = pending[-1]
            missing = [part for part, own in zip(parts, keys, strict=True) if own not in known]
            if missing and key not in known:
                pending += map(_opened, missing)
                continue
            pending.pop()
            if key in known:
                continue
            if changed.isdisjoint(keys):
                known[key] = node
                continue
            new = [known[own] for own in keys]
            if node.is_output():
                known[key] = new[0].get_output(node.which_output())
            elif node.is_call():
                known[key] = node.which_function()(*new)[0].dep(0)
            else:
                known[key] = applied(node.op(), *new)
            if known[key].element_hash() != key:
                changed.add(key)
    return ca.SX(expression.sparsity(), ca.vertcat(*[known[root.element_hash()] for root in roots]))


def _opened(node: ca.SX) -> tuple[ca.SX, int, list[ca.SX], list[int]]:
    """A node with its hash, its operands and their hashes."""
    parts = [node.dep(k) for k in range(node.n_dep())]
    return node, node.element_hash(), parts, [part.element_hash() for part in parts]
