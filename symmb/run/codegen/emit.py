"""Vectorised C code of a graph of values. One statement computes a value for all samples: a vector with lanes."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from symmb._errors import DeclarationError
from symmb.declare.symbolic import operation_name
from symmb.run.codegen.graph import BOX, CONSTANT, INPUT, SEARCH, Graph

LARGE_MODEL = 5000
"""Number of values of a model above which a function computes sines and cosines. With inline code, compilers would take
minutes. tests/benchmarks/scaling.py"""

_CHUNK = 400
"""Statements in one C function. The time of compilers grows faster than the length. tests/benchmarks/scaling.py"""

_PART = 50
"""Number of pieces of functions in one part. The parts of a large model are compiled in parallel."""

_FORMS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_LT: "truth({0} < {1})",
    ca.OP_LE: "truth({0} <= {1})",
    ca.OP_EQ: "truth({0} == {1})",
    ca.OP_NE: "truth({0} != {1})",
    ca.OP_NOT: "truth({0} == 0.0)",
    ca.OP_AND: "truth(({0} != 0.0) & ({1} != 0.0))",
    ca.OP_OR: "truth(({0} != 0.0) | ({1} != 0.0))",
    ca.OP_IF_ELSE_ZERO: "choose({0} != 0.0, {1}, zero())",
    ca.OP_FABS: "v_fabs(each({0}))",
    ca.OP_SIGN: "truth({0} > 0.0) - truth({0} < 0.0)",
    ca.OP_FMIN: "v_fmin(each({0}), each({1}))",
    ca.OP_FMAX: "v_fmax(each({0}), each({1}))",
}
_CALLS = {
    getattr(ca, f"OP_{name.upper()}"): f"v_{name}"
    for name in (
        "sqrt sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log log1p expm1 erf floor ceil pow atan2 "
        "fmod remainder copysign hypot"
    ).split()
}
_CALLS[ca.OP_CONSTPOW] = "v_pow"
_POWERS = {-2.0: "1.0 / ({0} * {0})", -1.0: "1.0 / {0}", 3.0: "{0} * {0} * {0}", 4.0: "({0} * {0}) * ({0} * {0})"}
_MASKS = {ca.OP_AND, ca.OP_OR, ca.OP_FMIN, ca.OP_FMAX}
"""Operations that combine masks. In C a comparison of plain numbers is an int, which is not a mask of lanes."""
_LITERAL = 0.0, 1.0, -1.0
"""Numbers that stay in the code, because compilers then have less to do."""
_TURNED = {ca.OP_SIN: ca.OP_COS, ca.OP_COS: ca.OP_SIN}
"""Sine -> cosine, and cosine -> sine. Sine and cosine of an angle together cost little more than one of both."""


@dataclass(frozen=True)
class _Schedule:
    """The statements of a function in pieces.

    The first pieces compute angles. A loop after them computes the sines and cosines of all angles. The loop computes
    many sines and cosines in parallel. Separate calls would compute one after the other.

    Attributes
    ----------
    pieces : statements of each piece, which are nodes of the graph
    n_first : number of pieces before the loop
    angles : nodes of angles for the loop, which computes their sines and cosines
    carried : node -> place of a value that a piece passes to later pieces
    twins : node of a sine -> node of its cosine, and back
    outputs : nodes that the function writes to `out`
    parameters_only : whether the function is `prepare`, which has no x and t
    """

    pieces: list[list[int]]
    n_first: int
    angles: list[int]
    carried: dict[int, int]
    twins: dict[int, int]
    outputs: list[int]
    parameters_only: bool

    @property
    def out(self) -> str:
        """Name of the array of results in C."""
        return "c" if self.parameters_only else "out"

    @cached_property
    def piece(self) -> dict[int, int]:
        """Node of each statement -> number of its piece."""
        return {k: i for i, piece in enumerate(self.pieces) for k in piece}


class Emitter:
    """Generates the functions of a graph with inputs x (0), p (1), t (2) and box (3). `place` gives places of x in C.

    Functions of a box of states receive the box instead of x. Once in a run, `prepare` computes the values that depend
    on parameters alone, and stores them in c. All other functions start from x, c and t. If `numbers_as_data`, numbers
    are read from c, so that models with other numbers have the same code.
    """

    def __init__(self, graph: Graph, place: Sequence[int], numbers_as_data: bool = False) -> None:
        self._graph, self._place, self._numbers_as_data = graph, place, numbers_as_data
        self._numbers: dict[int, int] = {}  # node -> place behind the values of parameters in c
        self._parameter_values: dict[int, int] = {}  # node -> place in c
        self._pieces: list[str] = []
        self.n_carried = 0  # largest number of values that the pieces of a function pass to each other

    @property
    def numbers(self) -> list[float]:
        """The numbers that the functions read from c."""
        return [self._graph.nodes[k].constant for k in self._numbers]

    def inputs(self, outputs: Iterable[int], source: int) -> list[int]:
        """Numbers of the nonzeros of input number `source` on which the given nodes depend."""
        needed = (self._graph.nodes[k] for k in self._graph.needed(outputs))
        return sorted(node.index for node in needed if node.operation == INPUT and node.source == source)

    def source(self, outputs: Mapping[str, list[int]]) -> tuple[list[str], str, int]:
        """C code in three items: pieces in parts; the functions, with `prepare(p, c)`; and the size of c.

        `outputs`: name -> the nodes that the C function `name(x, c, t, out)` writes to out.
        """
        functions = [self._source(name, nodes, parameters_only=False) for name, nodes in outputs.items()]
        # `prepare` is last, because the other functions decide which values of parameters are needed.
        functions.append(self._source("prepare", list(self._parameter_values), parameters_only=True))
        parts = ["\n".join(self._pieces[at : at + _PART]) for at in range(0, len(self._pieces), _PART)]
        heads = [f"{piece.partition(' {')[0]};" for piece in self._pieces]
        return parts, "\n".join([*heads, *functions]), len(self._parameter_values)

    def _hoisted(self, k: int) -> bool:
        node = self._graph.nodes[k]
        return node.operation != CONSTANT and node.depends == frozenset([1])

    def _source(self, name: str, outputs: list[int], parameters_only: bool) -> str:
        """The C code of one function. Its pieces of at most _CHUNK statements pass values to each other through w."""
        schedule = self._schedule(outputs, parameters_only)
        self.n_carried = max(self.n_carried, 1 + max(schedule.carried.values(), default=-1))
        inputs = "p" if parameters_only else "x, c, t"
        arguments = "const V *restrict p" if parameters_only else "const V *restrict x, const V *restrict c, V t"
        out = schedule.out
        names = ("p", "w", "c") if parameters_only else ("x", "c", "t", "w", "out")
        unused = f"{', '.join(f'(void){name}' for name in names)};"
        calls = []
        for piece in range(len(schedule.pieces)):
            lines = self._piece(schedule, piece)
            head = f"PIECE void {name}_{piece}({arguments}, V *restrict w, V *restrict {out})"
            self._pieces.append("\n".join([f"{head} {{", f"  {unused}", *lines, "}"]))
            calls.append(f"  {name}_{piece}({inputs}, c + N_C + N_NUMBERS, {out});")
        if schedule.angles:
            calls.insert(schedule.n_first, f"  sines({len(schedule.angles)}, c + N_C + N_NUMBERS);")
        head = "const V *restrict p, V *c" if parameters_only else "const V *restrict x, V *c, V t, V *restrict out"
        return "\n".join([f"MODEL void {name}({head}) {{", *calls, "}"])

    def _schedule(self, outputs: list[int], parameters_only: bool) -> _Schedule:
        nodes = self._graph.nodes
        order, twins = self._statements(outputs, parameters_only)
        angles = self._angles(order) if len(nodes) > LARGE_MODEL else []
        place = {angle: 2 * i for i, angle in enumerate(angles)}
        turned = [k for k in order if nodes[k].operation in _TURNED and nodes[k].arguments[0] in place]
        sines = {k: place[nodes[k].arguments[0]] + (nodes[k].operation == ca.OP_COS) for k in turned}
        needed = self._graph.needed(angles)
        first = _chunks(k for k in order if k in needed) if angles else []
        pieces = first + _chunks(k for k in order if k not in needed and k not in sines)
        carried = sines | self._carried(pieces, 2 * len(angles))
        return _Schedule(pieces, len(first), angles, carried, twins, outputs, parameters_only)

    def _statements(self, outputs: list[int], parameters_only: bool) -> tuple[list[int], dict[int, int]]:
        """The values that a function computes, in order, and pairs of sine and cosine, which follow each other."""
        nodes = self._graph.nodes
        given = (lambda k: False) if parameters_only else self._hoisted
        computed = [k for k in self._graph.needed(outputs, given) if nodes[k].operation not in (CONSTANT, INPUT)]
        order = [k for k in computed if parameters_only or not self._hoisted(k)]
        turns = {(nodes[k].operation, nodes[k].arguments): k for k in order if nodes[k].operation in _TURNED}
        twins = {k: turns[_TURNED[code], a] for (code, a), k in turns.items() if (_TURNED[code], a) in turns}
        # The later statement moves to the earlier statement. This is possible, because both have the same argument.
        return sorted(order, key=lambda k: (min(k, twins.get(k, k)), k)), twins

    def _angles(self, order: Sequence[int]) -> list[int]:
        """Arguments of sines and cosines, except those that depend on other sines or cosines."""
        nodes, behind = self._graph.nodes, set[int]()
        angles: dict[int, None] = {}
        for k in order:
            if not behind.isdisjoint(nodes[k].arguments):
                behind.add(k)
            elif nodes[k].operation in _TURNED:
                angles[nodes[k].arguments[0]] = None
                behind.add(k)
        return list(angles)

    def _carried(self, pieces: Sequence[Sequence[int]], count: int) -> dict[int, int]:
        """Places in w of values that later pieces use. The first place is `count`."""
        # Places are allocated like registers: a place is free after the last piece that uses it. So w stays small.
        piece = {k: i for i, ks in enumerate(pieces) for k in ks}
        last_use = dict(piece)
        for k, i in piece.items():
            last_use.update((a, max(last_use[a], i)) for a in self._graph.nodes[k].arguments if a in last_use)
        carried, free = dict[int, int](), list[int]()
        released: dict[int, list[int]] = {}
        for i, ks in enumerate(pieces):
            free += released.pop(i - 1, [])
            for k in ks:
                if last_use[k] > i:
                    if not free:
                        free, count = [count], count + 1
                    carried[k] = free.pop()
                    released.setdefault(last_use[k], []).append(carried[k])
        return carried

    def _piece(self, schedule: _Schedule, piece: int) -> list[str]:
        """The statements of a piece: values, copies for later pieces, and results."""
        results = [(k, f"{schedule.out}[{i}]") for i, k in enumerate(schedule.outputs)]
        angles = [(k, f"w[{2 * i}]") for i, k in enumerate(schedule.angles)]
        places: dict[int, list[str]] = {}
        for k, place in [*results, *(angles if piece < schedule.n_first else ())]:
            places.setdefault(k, []).append(place)
        lines = []
        for k in schedule.pieces[piece]:
            operands = [self._operand(a, schedule, piece) for a in self._graph.nodes[k].arguments]
            twin = schedule.twins.get(k)
            if twin is None or schedule.piece[twin] != piece:
                lines.append(f"  const V v{k} = {self._expression(k, operands)};")
            elif k < twin:
                sine, cosine = (k, twin) if self._graph.nodes[k].operation == ca.OP_SIN else (twin, k)
                lines.append(f"  V v{sine}, v{cosine};")
                lines.append(f"  v_sincos(each({operands[0]}), &v{sine}, &v{cosine});")
            if k in schedule.carried:
                lines.append(f"  w[{schedule.carried[k]}] = v{k};")
            lines += [f"  {place} = v{k};" for place in places.get(k, ())]
        # Results that no piece computes, such as constants, inputs and sines of the loop, are written at the end.
        at_end = {schedule.n_first - 1: angles, len(schedule.pieces) - 1: results}.get(piece, [])
        at_end = [(k, place) for k, place in at_end if k not in schedule.piece]
        return lines + [f"  {place} = each({self._operand(k, schedule, piece)});" for k, place in at_end]

    def _operand(self, a: int, schedule: _Schedule, piece: int) -> str:
        """The C code of an operand in a statement of a piece."""
        node = self._graph.nodes[a]
        if node.operation == CONSTANT:
            if not self._numbers_as_data or node.constant in _LITERAL or not math.isfinite(node.constant):
                return _literal(node.constant)
            return f"c[N_C + {self._numbers.setdefault(a, len(self._numbers))}]"
        if schedule.parameters_only and node.operation == INPUT:
            return f"p[{node.index}]"
        if self._hoisted(a) and not schedule.parameters_only:
            return f"c[{self._parameter_values.setdefault(a, len(self._parameter_values))}]"
        if node.operation == INPUT:
            if node.source == BOX:
                return f"x[{node.index}]"
            return f"x[{self._place[node.index]}]" if node.source == 0 else "t"
        return f"v{a}" if schedule.piece.get(a) == piece else f"w[{schedule.carried[a]}]"

    def _expression(self, k: int, arguments: list[str]) -> str:
        node, each = self._graph.nodes[k], [f"each({a})" for a in arguments]
        constants = [self._graph.nodes[a].operation == CONSTANT for a in node.arguments]
        if node.operation == ca.OP_CONSTPOW:
            power = _POWERS.get(self._graph.nodes[node.arguments[1]].constant)
            if power is not None:
                return power.format(arguments[0])
        if node.pieces is not None:
            count = node.pieces.data.shape[1]
            if node.operation == SEARCH:
                return f"v_search({node.pieces.name}, {count}, {', '.join(each)})"
            return f"v_entry({node.pieces.name} + {(node.index + 2) * count}, {arguments[0]})"
        if node.operation in _CALLS:
            return f"{_CALLS[node.operation]}({', '.join(each)})"
        if node.operation not in _FORMS:
            raise DeclarationError(f"The compiled engine does not support {operation_name(node.operation)}.")
        plain = all(constants) or (any(constants) and node.operation in _MASKS)
        return _FORMS[node.operation].format(*(each if plain else arguments))


def _chunks(statements: Iterable[int]) -> list[list[int]]:
    """The statements in pieces of at most _CHUNK. There is at least one piece."""
    every = list(statements)
    return [every[at : at + _CHUNK] for at in range(0, len(every), _CHUNK)] or [[]]


def _literal(value: float) -> str:
    if math.isnan(value):
        return "(0.0 / 0.0)"
    return f"({value!r})" if math.isfinite(value) else f"({math.copysign(1.0, value)} / 0.0)"
