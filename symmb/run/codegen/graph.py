"""The instructions of a CasADi Function as a graph. Each value occurs once, with the inputs on which it depends."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import casadi as ca

from symmb.declare.symbolic import Entry, Pieces, interpret

CONSTANT, INPUT, SEARCH, ENTRY = range(-1, -5, -1)
"""Operations of a Node that are not operations of CasADi. They have negative numbers. A SEARCH finds the row of pieces,
and an ENTRY is the number in column `index` of this row."""
BOX = 3
"""Number of the input `box`. Functions of a box of states have it instead of x; see `ranges_along`."""


@dataclass(frozen=True)
class Node:
    """A value: CasADi's operation on earlier nodes, a constant, or nonzero `index` of input number `source`."""

    operation: int
    arguments: tuple[int, ...] = ()
    constant: float = 0.0
    source: int = 0
    index: int = 0
    depends: frozenset[int] = frozenset()  # the inputs it depends on, by index
    pieces: Pieces | None = None


@dataclass
class Graph:
    """Values of one or several Functions of the same inputs, in an order in which they can be computed."""

    nodes: list[Node] = field(default_factory=list)
    outputs: list[list[int]] = field(default_factory=list)
    _known: dict[object, int] = field(default_factory=dict)

    def constant(self, value: float) -> int:
        """The node of a constant."""
        # repr distinguishes 0.0 and -0.0, which compare equal
        return self._add(("constant", repr(value)), Node(CONSTANT, constant=value))

    def source(self, number: int, index: int) -> int:
        """The node of nonzero `index` of input `number`."""
        return self._add(("input", number, index), Node(INPUT, source=number, index=index, depends=frozenset([number])))

    def operation(self, code: int | Entry, arguments: tuple[int, ...]) -> int:
        """The node of an operation on nodes, or of an entry of pieces. Equal operations have the same node."""
        # A vector division takes as long as twenty products. A product with a reciprocal is faster: a denominator that
        # occurs several times is inverted once, and denominators of parameters are inverted before the run.
        if code == ca.OP_DIV:
            code, arguments = ca.OP_MUL, (arguments[0], self.operation(ca.OP_INV, arguments[1:]))
        if code in (ca.OP_ADD, ca.OP_MUL):
            arguments = tuple(sorted(arguments))
        depends = frozenset().union(*(self.nodes[a].depends for a in arguments))
        if isinstance(code, Entry):
            pieces, column = code
            found = self._add(
                (SEARCH, pieces.name, *arguments), Node(SEARCH, arguments, depends=depends, pieces=pieces)
            )
            entry = Node(ENTRY, (found,), index=column, depends=depends, pieces=pieces)
            return self._add((ENTRY, found, column), entry)
        return self._add((code, *arguments), Node(code, arguments, depends=depends))

    def needed(self, outputs: Iterable[int], is_given: Callable[[int], bool] = lambda k: False) -> set[int]:
        """The nodes `outputs`, and all nodes on which they depend. The operands of given nodes are left out."""
        needed: set[int] = set()
        pending = list(outputs)
        while pending:
            k = pending.pop()
            if k not in needed:
                needed.add(k)
                pending.extend(() if is_given(k) else self.nodes[k].arguments)
        return needed

    @property
    def pieces(self) -> dict[str, Pieces]:
        """All pieces of the graph by name."""
        return {node.pieces.name: node.pieces for node in self.nodes if node.pieces is not None}

    def _add(self, key: object, node: Node) -> int:
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append(node)
        return self._known[key]


def graph_of(f: ca.Function) -> Graph:
    """The graph of an SX Function. `outputs` has, for each output, the nodes of the nonzeros in column order."""
    graph = Graph()
    inputs: Sequence[Sequence[int]] = [[graph.source(k, i) for i in range(f.nnz_in(k))] for k in range(f.n_in())]
    graph.outputs = interpret(f, inputs, graph.operation, graph.constant)
    return graph
