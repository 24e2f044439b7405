"""The instructions of a CasADi Function as a graph. Each value occurs once, with the inputs on which it depends."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from symmb._errors import DeclarationError
from symmb.declare.symbolic import ENTRY, Pieces, instructions

CONSTANT, INPUT, SEARCH = -2, -3, -4
"""Operations of a node that are not operations of CasADi, besides ENTRY. A SEARCH finds the row of pieces, and an ENTRY
is a number of this row."""
BOX = 3
"""Number of the input `box`. Functions of a box of states have it instead of x; see `ranges_along`."""
_COMMUTE = {ca.OP_ADD, ca.OP_MUL}


@dataclass
class Graph:
    """Values of a Function, called nodes, in an order in which they can be computed. A node is given by its number.

    Attributes
    ----------
    operations : by node     CasADi's operation, or CONSTANT, INPUT, SEARCH or ENTRY
    arguments : by node      earlier nodes
    depends : by node        the inputs on which it depends: bit k for input number k
    data : by node           value of a constant, number and nonzero of an input, pieces of a search, column of an entry
    outputs                  for each output, the nodes of the nonzeros in column order
    """

    operations: list[int] = field(default_factory=list)
    arguments: list[tuple[int, ...]] = field(default_factory=list)
    depends: list[int] = field(default_factory=list)
    data: list[Any] = field(default_factory=list)
    outputs: list[list[int]] = field(default_factory=list)

    def users(self, groups: Sequence[Iterable[int]], is_given: Sequence[bool] = ()) -> list[int]:
        """For each node the groups that depend on it: bit i for the nodes `groups[i]`. A given node has no operands."""
        users = [0] * len(self.operations)
        for i, group in enumerate(groups):
            for k in group:
                users[k] |= 1 << i
        for k in range(len(users) - 1, -1, -1):
            if users[k] and not (is_given and is_given[k]):
                for a in self.arguments[k]:
                    users[a] |= users[k]
        return users

    def inputs(self, outputs: Iterable[int], source: int) -> list[int]:
        """Numbers of the nonzeros of input number `source` on which the given nodes depend."""
        users = self.users([outputs])
        found = (self.data[k] for k, operation in enumerate(self.operations) if operation == INPUT and users[k])
        return sorted(index for number, index in found if number == source)

    @property
    def pieces(self) -> dict[str, Pieces]:
        """All pieces of the graph by name."""
        return {self.data[k].name: self.data[k] for k, code in enumerate(self.operations) if code == SEARCH}


def graph_of(f: ca.Function) -> Graph:
    """The graph of an SX Function."""
    graph, known = Graph(outputs=[[0] * f.nnz_out(i) for i in range(f.n_out())]), dict[object, int]()

    def node(key: object, operation: int, arguments: tuple[int, ...] = (), data: Any = None, depends: int = 0) -> int:
        if key not in known:
            for a in arguments:
                depends |= graph.depends[a]
            graph.operations.append(operation)
            graph.arguments.append(arguments)
            graph.depends.append(depends)
            graph.data.append(data)
            known[key] = len(known)
        return known[key]

    for source in range(f.n_in()):
        for index in range(f.nnz_in(source)):
            node((INPUT, source, index), INPUT, data=(source, index), depends=1 << source)
    zero, own, nodes = node("0.0", CONSTANT, data=0.0), instructions(f), list[int]()  # the node of each row
    for row, (code, a, b) in enumerate(own.rows()):
        a, b = nodes[a] if a >= 0 else -1, nodes[b] if b >= 0 else -1
        data: Any = own.data.get(row)
        if code == ca.OP_INPUT:
            k = known[INPUT, *data]
        elif code == ca.OP_CONST:  # repr distinguishes 0.0 and -0.0, which compare equal
            k = node(repr(data), CONSTANT, data=data)
        elif code == ca.OP_OUTPUT:
            graph.outputs[data[0]][data[1]] = k = a
        elif code == ENTRY:
            search = zero if data is None else node((SEARCH, data.pieces.name, a, b), SEARCH, (a, b), data.pieces)
            k = zero if data is None else node((ENTRY, search, data.column), ENTRY, (search,), data.column)
        elif code == ca.OP_CALL:
            raise DeclarationError(f"Function '{f.name()}' calls another Function. Build it without never_inline.")
        else:
            # A vector division takes as long as twenty products. A product with a reciprocal is faster: a denominator
            # that occurs several times is inverted once, and denominators of parameters are inverted before the run.
            if code == ca.OP_DIV:
                code, b = ca.OP_MUL, node((ca.OP_INV, b), ca.OP_INV, (b,))
            key = (code, b, a) if a > b >= 0 and code in _COMMUTE else (code, a, b)[: 1 + (a >= 0) + (b >= 0)]
            k = node(key, code, key[1:])
        nodes.append(k)
    return graph
