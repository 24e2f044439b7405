"""Vectorised C code of a graph of values. One statement computes a value for all samples: a vector with lanes."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import casadi as ca

from symmb._errors import DeclarationError
from symmb.declare.symbolic import ENTRY, operation_name
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
    n_always : number of pieces that every run needs; only runs with an integral of the power call the others
    outputs : nodes that the function writes to `out`
    guarded : whether only these runs write the last output
    parameters_only : whether the function is `prepare`, which has no x and t
    """

    pieces: list[list[int]]
    n_first: int
    n_always: int
    angles: list[int]
    carried: dict[int, int]
    twins: dict[int, int]
    outputs: list[int]
    guarded: bool
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
    """Generates functions of a graph with inputs x (0), p (1), t (2) and box (3). `place` gives places of x in C.

    Functions of a box of states receive the box instead of x. Once in a run, `prepare` computes the values that depend
    on parameters alone, and stores them in c. All other functions start from x, c and t. If `numbers_as_data`, numbers
    are read from c, so that models with other numbers have the same code.

    Parameters
    ----------
    before : Emitter, optional      of functions whose values and numbers in c these functions use too. Further values
                                    and numbers follow in c
    guarded                         names of functions that write their last output only in runs with an integral of the
                                    power
    """

    def __init__(
        self,
        graph: Graph,
        place: Sequence[int],
        numbers_as_data: bool = False,
        before: "Emitter | None" = None,
        guarded: Collection[str] = (),
    ) -> None:
        self._graph, self._place, self._numbers_as_data, self._guarded = graph, place, numbers_as_data, guarded
        self._first = 1 + sum(operation == INPUT for operation in graph.operations)  # inputs do not count in names
        self._given, self.begin = ({}, 0) if before is None else ({**before._given, **before._own}, before.end)
        self._numbers: dict[int, int] = {}  # node -> place behind the values of parameters in c
        self._hoisted = [depends == 1 << 1 for depends in graph.depends]  # whether a node depends on p alone
        self._parameter_values: dict[int, int] = {}  # node -> place in c
        self._is_large = False
        self._pieces: list[str] = []
        self.n_carried = 0  # largest number of values that the pieces of a function pass to each other

    @property
    def numbers(self) -> dict[int, float]:
        """The numbers that the functions read from c, by their places."""
        own = self._own
        return {own[k]: self._graph.data[k] for k in self._numbers}

    @property
    def numbers_at(self) -> int:
        """The place in c of the first number."""
        return self.begin + len(self._parameter_values)

    @property
    def end(self) -> int:
        """The place in c after the values and numbers."""
        return self.numbers_at + len(self._numbers)

    @property
    def _own(self) -> dict[int, int]:
        """Node -> place in c of a value or number."""
        values = {k: self.begin + i for k, i in self._parameter_values.items()}
        return values | {k: self.numbers_at + i for k, i in self._numbers.items()}

    def source(self, outputs: Mapping[str, list[int]], prepare: str) -> tuple[list[str], str, bool]:
        """C code in three items: pieces in parts; the functions, with prepare(p, c); and whether the code is large.

        `outputs`: name -> the nodes that the C function `name(x, c, t, out)` writes to out. `prepare` is the name of
        the function of parameters.
        """
        users = self._graph.users([*outputs.values()], self._hoisted)
        own = [k for k, hoisted in enumerate(self._hoisted) if not hoisted]
        self._is_large = sum(map(bool, users)) > LARGE_MODEL
        functions = [
            self._source(name, nodes, [k for k in own if users[k] >> i & 1], parameters_only=False)
            for i, (name, nodes) in enumerate(outputs.items())
        ]
        # `prepare` is last, because the other functions decide which values of parameters are needed.
        values, given = [*self._parameter_values], [k in self._given for k in range(len(users))]
        users = self._graph.users([values], given)
        own = [k for k, of in enumerate(users) if of and not given[k]]
        functions.append(self._source(prepare, values, own, parameters_only=True))
        parts = ["\n".join(self._pieces[at : at + _PART]) for at in range(0, len(self._pieces), _PART)]
        heads = [f"{piece.partition(' {')[0]};" for piece in self._pieces]
        return parts, "\n".join([*heads, *functions]), self._is_large

    def _source(self, name: str, outputs: list[int], computed: list[int], parameters_only: bool) -> str:
        """The C code of one function. Its pieces of at most _CHUNK statements pass values to each other through w."""
        schedule = self._schedule(outputs, computed, parameters_only, name in self._guarded)
        self.n_carried = max(self.n_carried, 1 + max(schedule.carried.values(), default=-1))
        inputs = "p" if parameters_only else "x, c, t"
        arguments = "const V *restrict p" if parameters_only else "const V *restrict x, const V *restrict c, V t"
        out = schedule.out
        names = ("p", "w", "c") if parameters_only else ("x", "c", "t", "w", "out")
        unused = f"{', '.join(f'(void){name}' for name in names)};"
        calls = ["  prepare_equations(p, c);"] if parameters_only and self.begin else []
        for piece in range(len(schedule.pieces)):
            lines = self._piece(schedule, piece)
            head = f"PIECE void {name}_{piece}({arguments}, V *restrict w, V *restrict {out})"
            self._pieces.append("\n".join([f"{head} {{", f"  {unused}", *lines, "}"]))
            only = "if (POWER) " if piece >= schedule.n_always else ""
            calls.append(f"  {only}{name}_{piece}({inputs}, c + WORK, {out});")
        if schedule.angles:
            calls.insert(schedule.n_first, f"  sines({len(schedule.angles)}, c + WORK);")
        head = "const V *restrict p, V *c" if parameters_only else "const V *restrict x, V *c, V t, V *restrict out"
        return "\n".join([f"MODEL void {name}({head}) {{", *calls, "}"])

    def _schedule(self, outputs: list[int], computed: list[int], parameters_only: bool, guarded: bool) -> _Schedule:
        operations, arguments = self._graph.operations, self._graph.arguments
        always = self._graph.users([outputs[:-1]]) if guarded else [1] * len(operations)
        order, twins = self._statements(sorted(computed, key=lambda k: not always[k]))
        angles = self._angles(order) if self._is_large else []
        place = {angle: 2 * i for i, angle in enumerate(angles)}
        turned = [k for k in order if operations[k] in _TURNED and arguments[k][0] in place]
        sines = {k: place[arguments[k][0]] + (operations[k] == ca.OP_COS) for k in turned}
        needed = self._graph.users([angles])
        first = (_chunks(k for k in order if needed[k]) or [[]]) if angles else []
        later = [k for k in order if not needed[k] and k not in sines]
        last = next((i for i, k in reversed([*enumerate(later, 1)]) if always[k]), 0)
        pieces = first + (_chunks(later[:last]) or [[]])
        n_always, pieces = len(pieces), pieces + _chunks(later[last:])
        carried = sines | self._carried(pieces, 2 * len(angles))
        return _Schedule(pieces, len(first), n_always, angles, carried, twins, outputs, guarded, parameters_only)

    def _statements(self, computed: list[int]) -> tuple[list[int], dict[int, int]]:
        """The operations among computed nodes, in order, and pairs of sine and cosine, which follow each other."""
        operations, arguments = self._graph.operations, self._graph.arguments
        order = [k for k in computed if operations[k] not in (CONSTANT, INPUT)]
        turns = {(operations[k], arguments[k]): k for k in order if operations[k] in _TURNED}
        twins = {k: turns[_TURNED[code], a] for (code, a), k in turns.items() if (_TURNED[code], a) in turns}
        # The later statement moves to the earlier statement. This is possible, because both have the same argument.
        at = {k: i for i, k in enumerate(order)}
        pairs = ((k, twins[k]) if k in twins else (k,) for k in order if at[twins.get(k, k)] >= at[k])
        return [k for pair in pairs for k in pair], twins

    def _angles(self, order: Sequence[int]) -> list[int]:
        """Arguments of sines and cosines, except those that depend on other sines or cosines."""
        operations, arguments, behind = self._graph.operations, self._graph.arguments, set[int]()
        angles: dict[int, None] = {}
        for k in order:
            if not behind.isdisjoint(arguments[k]):
                behind.add(k)
            elif operations[k] in _TURNED:
                angles[arguments[k][0]] = None
                behind.add(k)
        return list(angles)

    def _carried(self, pieces: Sequence[Sequence[int]], count: int) -> dict[int, int]:
        """Places in w of values that later pieces use. The first place is `count`."""
        # Places are allocated like registers: a place is free after the last piece that uses it. So w stays small.
        last_use: dict[int, int] = {}
        for i, ks in enumerate(pieces):
            last_use.update(dict.fromkeys(chain.from_iterable(map(self._graph.arguments.__getitem__, ks)), i))
        carried, free = dict[int, int](), list[int]()
        released: dict[int, list[int]] = {}
        for i, ks in enumerate(pieces):
            free += released.pop(i - 1, [])
            for k in ks:
                if last_use.get(k, i) > i:
                    if not free:
                        free, count = [count], count + 1
                    carried[k] = free.pop()
                    released.setdefault(last_use[k], []).append(carried[k])
        return carried

    def _piece(self, schedule: _Schedule, piece: int) -> list[str]:
        """The statements of a piece: values, copies for later pieces, and results."""
        first = self.begin if schedule.parameters_only else 0
        results = [(k, f"{schedule.out}[{i}]") for i, k in enumerate(schedule.outputs, first)]
        if schedule.guarded:
            results[-1] = results[-1][0], f"if (POWER) {results[-1][1]}"
        angles = [(k, f"w[{2 * i}]") for i, k in enumerate(schedule.angles)]
        places: dict[int, list[str]] = {}
        for k, place in [*results, *(angles if piece < schedule.n_first else ())]:
            places.setdefault(k, []).append(place)
        operations, arguments, carried, lines = self._graph.operations, self._graph.arguments, schedule.carried, []
        names: dict[int, str] = {}  # of the values in this piece
        for k in schedule.pieces[piece]:
            operands = [names.get(a) or self._operand(a, schedule) for a in arguments[k]]
            names[k] = value = self._name(k)
            twin = schedule.twins.get(k)
            if twin is None or schedule.piece[twin] != piece:
                lines.append(f"  const V {value} = {self._expression(k, operands)};")
            elif twin not in names:
                sine, cosine = (k, twin) if operations[k] == ca.OP_SIN else (twin, k)
                sine, cosine = self._name(sine), self._name(cosine)
                lines.append(f"  V {sine}, {cosine};")
                lines.append(f"  v_sincos(each({operands[0]}), &{sine}, &{cosine});")
            if k in carried:
                lines.append(f"  w[{carried[k]}] = {value};")
            if k in places:
                lines += [f"  {place} = {value};" for place in places[k]]
        # Results that no piece computes, such as constants, inputs and sines of the loop, are written at the end.
        at_end = {schedule.n_first - 1: angles, schedule.n_always - 1: results}.get(piece, [])
        at_end = [(k, place) for k, place in at_end if k not in schedule.piece]
        return lines + [f"  {place} = each({self._operand(k, schedule)});" for k, place in at_end]

    def _operand(self, a: int, schedule: _Schedule) -> str:
        """The C code of an operand that a piece does not compute itself."""
        operation, data = self._graph.operations[a], self._graph.data[a]
        if operation == CONSTANT and (not self._numbers_as_data or data in _LITERAL or not math.isfinite(data)):
            return _literal(data)
        if a in self._given:
            return f"c[{self._given[a]}]"
        if operation == CONSTANT:
            return f"c[NUMBERS + {self._numbers.setdefault(a, len(self._numbers))}]"
        if schedule.parameters_only and operation == INPUT:
            return f"p[{data[1]}]"
        if self._hoisted[a] and not schedule.parameters_only:
            return f"c[{self.begin + self._parameter_values.setdefault(a, len(self._parameter_values))}]"
        if operation == INPUT:
            source, index = data
            if source == BOX:
                return f"x[{index}]"
            return f"x[{self._place[index]}]" if source == 0 else "t"
        return f"w[{schedule.carried[a]}]"

    def _name(self, k: int) -> str:
        return f"v{k - self._first}"

    def _expression(self, k: int, operands: list[str]) -> str:
        graph, operation, arguments = self._graph, self._graph.operations[k], self._graph.arguments[k]
        if operation in _FORMS:
            if operation in _MASKS or not graph.depends[k]:
                constants = [graph.operations[a] == CONSTANT for a in arguments]
                if all(constants) or (any(constants) and operation in _MASKS):
                    operands = [f"each({a})" for a in operands]
            return _FORMS[operation].format(*operands)
        each = [f"each({a})" for a in operands]
        if operation == ca.OP_CONSTPOW:
            power = _POWERS.get(graph.data[arguments[1]])
            if power is not None:
                return power.format(operands[0])
        if operation in (SEARCH, ENTRY):
            pieces = graph.data[k if operation == SEARCH else arguments[0]]
            count = pieces.data.shape[1]
            if operation == SEARCH:
                return f"v_search({pieces.name}, {count}, {', '.join(each)})"
            return f"v_entry({pieces.name} + {(graph.data[k] + 2) * count}, {operands[0]})"
        if operation not in _CALLS:
            raise DeclarationError(f"The compiled engine does not support {operation_name(operation)}.")
        return f"{_CALLS[operation]}({', '.join(each)})"


def _chunks(statements: Iterable[int]) -> list[list[int]]:
    """The statements in pieces of at most _CHUNK."""
    every = list(statements)
    return [every[at : at + _CHUNK] for at in range(0, len(every), _CHUNK)]


def _literal(value: float) -> str:
    if math.isnan(value):
        return "(0.0 / 0.0)"
    return f"({value!r})" if math.isfinite(value) else f"({math.copysign(1.0, value)} / 0.0)"
