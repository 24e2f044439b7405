"""Evaluation of a graph of values on NumPy arrays, one lane for each sample, as in the C but without a compiler."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._types import Array, Mask
from symmb.codegen.graph import BOX, CONSTANT, INPUT, SEARCH, Graph, Node, Places
from symmb.symbolic import operation_name


def _truth(test: Callable[..., Mask], *values: Array) -> Array:
    """1 where a test holds, else 0."""
    return np.asarray(test(*values), dtype=float)


def _if_else_zero(a: Array, b: Array) -> Array:
    return np.where(np.not_equal(a, 0.0), b, 0.0)


def _sign(a: Array) -> Array:
    return np.greater(a, 0.0) * 1.0 - np.less(a, 0.0)


def _erf(a: Array) -> Array:
    from scipy.special import erf

    return erf(a)


def _remainder(a: Array, b: Array) -> Array:
    """The remainder of C: a minus the nearest multiple of b, the even one of two. NumPy's rounds the quotient down."""
    size = np.abs(b)
    rest = np.fmod(np.abs(a), size + size)
    less = rest - size
    rest = np.where(rest + rest > size, np.where(less + less >= size, less - size, less), rest)
    return np.where(np.signbit(a), -rest, rest)


def _cube(a: Array) -> Array:
    return a * a * a


def _fourth(a: Array) -> Array:
    return np.square(a * a)


def _inverse_square(a: Array) -> Array:
    return np.reciprocal(a * a)


_OPERATIONS: dict[int, Callable[..., Array]] = {
    ca.OP_ASSIGN: np.asarray,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: partial(np.multiply, 2.0),
    ca.OP_INV: np.reciprocal,
    ca.OP_LT: partial(_truth, np.less),
    ca.OP_LE: partial(_truth, np.less_equal),
    ca.OP_EQ: partial(_truth, np.equal),
    ca.OP_NE: partial(_truth, np.not_equal),
    ca.OP_NOT: partial(_truth, np.logical_not),
    ca.OP_AND: partial(_truth, np.logical_and),
    ca.OP_OR: partial(_truth, np.logical_or),
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: _sign,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh,
    ca.OP_ACOSH: np.arccosh,
    ca.OP_ATANH: np.arctanh,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1,
    ca.OP_ERF: _erf,
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_FMOD: np.fmod,
    ca.OP_REMAINDER: _remainder,
    ca.OP_COPYSIGN: np.copysign,
    ca.OP_HYPOT: np.hypot,
}
_POWERS: dict[float, Callable[..., Array]] = {-2.0: _inverse_square, -1.0: np.reciprocal, 3.0: _cube, 4.0: _fourth}


@dataclass(frozen=True)
class Program:
    """Operations on numbered slots, which are reused when their values are no longer needed."""

    size: int
    constants: tuple[tuple[int, float], ...]  # slot, value
    inputs: tuple[tuple[int, int, int], ...]  # slot, input, row of it
    operations: tuple[tuple[Callable[..., Array], tuple[int, ...], int], ...]  # function, slots of arguments, slot
    outputs: tuple[int, ...]

    def __call__(self, x: Array, p: Array, t: Array, out: Array | None = None) -> Array:
        """Outputs (n, L) from x (n_x, L), p (n_p, L) and t (L,), written to `out` if given."""
        slots: list = [None] * self.size
        inputs = x, p, (t,)
        for slot, value in self.constants:
            slots[slot] = value
        for slot, number, row in self.inputs:
            slots[slot] = inputs[number][row]
        for function, arguments, slot in self.operations:
            slots[slot] = function(*[slots[a] for a in arguments])
        out = np.empty((len(self.outputs), len(t))) if out is None else out
        for row, slot in enumerate(self.outputs):
            out[row] = slots[slot]
        return out


def programs(graph: Graph) -> tuple[Program, Sequence[Program]]:
    """A Program for values that depend on parameters alone, computed once in a run, and one for each output."""
    parameter_rows: dict[int, int] = {}  # node -> row of a value that depends on parameters alone

    def input_of(k: int) -> tuple[int, int] | None:
        node = graph.nodes[k]
        if node.operation != CONSTANT and node.depends == frozenset([1]):
            return 1, parameter_rows.setdefault(k, len(parameter_rows))
        return _row(node)

    def own(k: int) -> tuple[int, int] | None:
        return _row(graph.nodes[k])

    programs_of_outputs = [_program(graph, nodes, input_of) for nodes in graph.outputs]
    return _program(graph, list(parameter_rows), own), programs_of_outputs


def _row(node: Node) -> tuple[int, int] | None:
    """Input and row of an input: a box stands in the place of x."""
    return (0 if node.source == BOX else node.source, node.index) if node.operation == INPUT else None


def _program(graph: Graph, outputs: list[int], input_of: Callable[[int], tuple[int, int] | None]) -> Program:
    """The computation of outputs, where `input_of` gives input and row of a node that is given."""
    nodes, places = graph.nodes, Places()
    constants, sources, computed = _needed(graph, outputs, input_of)
    slot = {k: places.take() for k in (*constants, *sources)}
    last = {a: k for k in computed for a in nodes[k].arguments}
    last |= dict.fromkeys(outputs, -1)  # never free
    operations = []
    for k in computed:
        arguments = nodes[k].arguments
        at = tuple(slot[a] for a in arguments)
        places.release(slot[a] for a in set(arguments) if last[a] == k)
        slot[k] = places.take()
        operations.append((*_operation(graph, k, at), slot[k]))
    return Program(
        places.count,
        tuple((slot[k], value) for k, value in constants.items()),
        tuple((slot[k], *source) for k, source in sources.items()),
        tuple(operations),
        tuple(slot[k] for k in outputs),
    )


def _needed(
    graph: Graph, outputs: list[int], input_of: Callable[[int], tuple[int, int] | None]
) -> tuple[dict[int, float], dict[int, tuple[int, int]], list[int]]:
    """The nodes that outputs need: constants, those that are given, and those to compute, in order."""
    needed = sorted(graph.needed(outputs, lambda k: input_of(k) is not None))
    sources = {k: source for k in needed if (source := input_of(k)) is not None}
    constants = {k: graph.nodes[k].constant for k in needed if graph.nodes[k].operation == CONSTANT}
    return constants, sources, [k for k in needed if k not in constants and k not in sources]


def _operation(graph: Graph, k: int, at: tuple[int, ...]) -> tuple[Callable[..., Array], tuple[int, ...]]:
    node = graph.nodes[k]
    if node.operation == ca.OP_CONSTPOW:
        exponent = graph.nodes[node.arguments[1]].constant
        if exponent in _POWERS:
            return _POWERS[exponent], at[:1]
    if node.pieces is not None:
        read: Any = node.pieces.find if node.operation == SEARCH else node.pieces.data[2 + node.index].__getitem__
        return read, at
    if node.operation not in _OPERATIONS:
        raise DeclarationError(f"The compiled engine does not know {operation_name(node.operation)}.")
    return _OPERATIONS[node.operation], at
