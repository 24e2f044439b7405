"""Evaluation of the instructions of a CasADi SX Function with any number type.

CasADi evaluates an SX Function as a flat list of scalar instructions on a work vector. `Instructions` are this list,
read once. In `interpret`, the caller defines the operations. SymPy expressions in place of numbers give an export to
SymPy. Intervals give an interval evaluation.
"""

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb.declare.symbolic.pieces import Entry, entries_of

T = TypeVar("T")

_NAMES = {getattr(ca, name): name.removeprefix("OP_").lower() for name in dir(ca) if name.startswith("OP_")}


def operation_name(code: int | Entry) -> str:
    """Name of an operation code for messages.

    Examples
    --------
    >>> import casadi as ca
    >>> operation_name(ca.OP_ATAN2)
    'atan2'
    """
    return "table" if isinstance(code, Entry) else _NAMES.get(code, f"operation {code}")


ENTRY = -1
"""The operation of a row that reads an entry of pieces. It is not an operation of CasADi."""
_NOWHERE = [-1]
_SPECIAL = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_CALL, ENTRY}


@dataclass(frozen=True, eq=False)
class Instructions:
    """The instructions of an SX Function as rows. A row computes a value from the values of earlier rows.

    Attributes
    ----------
    codes            CasADi's ``OP_`` numbers or `ENTRY`
    first, second    rows of the arguments; -1 without argument
    data : by row    number of a constant, entry of pieces (None for 0), or number and nonzero of an input or output
    """

    codes: "array[int]"
    first: "array[int]"
    second: "array[int]"
    data: dict[int, Any]

    def rows(self) -> Iterator[tuple[int, int, int]]:
        """Code and arguments of each row."""
        return zip(self.codes, self.first, self.second, strict=True)

    def last_uses(self) -> list[int]:
        """The row that uses each value last; 0 for values that are not used."""
        operands = np.column_stack([self.first, self.second]).ravel()
        rows = np.repeat(np.arange(len(self.codes)), 2)
        last = np.zeros(len(self.codes), dtype=np.intp)
        last[operands[operands >= 0]] = rows[operands >= 0]  # of repeated operands, the last row stays
        return last.tolist()

    def identity(self) -> bytes:
        """Bytes that are equal for equal instructions."""
        plain = {k: (x.pieces.name, x.column) if isinstance(x, Entry) else x for k, x in self.data.items()}
        return b"".join([self.codes.tobytes(), self.first.tobytes(), self.second.tobytes(), repr(plain).encode()])

    def entries(self) -> list[Entry | None]:
        """The entries of pieces that rows read."""
        return [self.data[k] for k, code in enumerate(self.codes) if code == ENTRY]


_READ: WeakKeyDictionary[ca.Function, Instructions] = WeakKeyDictionary()


def instructions(f: ca.Function) -> Instructions:
    """The instructions of an SX Function. They are read once, because CasADi gives them one by one."""
    if f not in _READ:
        _READ[f] = _read(f)
    return _READ[f]


def _read(f: ca.Function) -> Instructions:
    codes, first, second, data = list[int](), list[int](), list[int](), dict[int, Any]()
    writer = [0] * (f.sz_w() + 1)  # the row that wrote each place of the work vector last; outputs write the last place
    nodes: Any = f.instructions_sx() if f.find_functions(0) else None
    every = range(f.n_instructions())
    reads = (map(read, every) for read in (f.instruction_id, f.instruction_input, f.instruction_output))
    for k, code, arguments, results in zip(every, *reads, strict=True):
        row, a, b = len(codes), -1, -1
        if code == ca.OP_INPUT:
            data[row] = arguments
        elif code == ca.OP_OUTPUT:
            a, data[row], results = writer[arguments[0]], results, _NOWHERE
        elif code == ca.OP_CONST:
            data[row] = f.instruction_constant(k)
        elif arguments:
            a, b = writer[arguments[0]], writer[arguments[1]] if len(arguments) > 1 else -1
        if code == ca.OP_CALL:
            entries = entries_of(nodes[k].which_function(), len(results))
            used = [i for i, place in enumerate(results) if place >= 0]
            data.update((row + n, entries[i]) for n, i in enumerate(used) if entries)
            code, results = ENTRY if entries else code, [results[i] for i in used]
        for place in results:
            writer[place] = len(codes)
            codes.append(code)
            first.append(a)
            second.append(b)
    return Instructions(array("i", codes), array("i", first), array("i", second), data)


def interpret(
    f: ca.Function,
    inputs: Sequence[Sequence[T]],
    operation: Callable[[Any, tuple[T, ...]], T],
    constant: Callable[[float], T],
    known: Mapping[int, T] = MappingProxyType({}),
) -> list[list[T]]:
    """Evaluate an SX Function with numbers of type T, instruction by instruction.

    `inputs` and the result are the structural nonzeros of each input and output, in column-major order.
    ``operation(code, arguments)`` gets one of CasADi's ``OP_`` numbers or an `Entry`, with one or two arguments (none
    for a free symbol, ``OP_PARAMETER``). `known` are given values of scalar outputs by index. Later outputs use the
    given values, too. Raises DeclarationError if f is not an SX Function or calls another Function, or if the inputs do
    not fit.

    Examples
    --------
    >>> import casadi as ca
    >>> x = ca.SX.sym("x", 2)
    >>> f = ca.Function("f", [x], [x[0] * x[1] + 3])
    >>> interpret(f, [["x0", "x1"]], lambda code, a: f"{operation_name(code)}({', '.join(a)})", str)
    [['add(mul(x0, x1), 3.0)']]
    """
    if not f.is_a("SXFunction"):
        raise DeclarationError(f"Function '{f.name()}' is not an SX Function. Expand it first: f.expand().")
    sizes, expected = [*map(len, inputs)], [f.nnz_in(i) for i in range(f.n_in())]
    if sizes != expected:
        raise DeclarationError(f"The inputs of '{f.name()}' have {expected} structural nonzeros, got {sizes} values.")
    own = instructions(f)
    values: list[Any] = [None] * len(own.codes)
    outputs: list[list[Any]] = [[None] * f.nnz_out(i) for i in range(f.n_out())]
    last = own.last_uses()
    for k, (code, a, b) in enumerate(own.rows()):
        if code not in _SPECIAL:
            values[k] = operation(code, (values[a], values[b]) if b >= 0 else (values[a],) if a >= 0 else ())
        elif code == ca.OP_INPUT:
            number, nonzero = own.data[k]
            values[k] = inputs[number][nonzero]
        elif code == ca.OP_OUTPUT:
            number, nonzero = own.data[k]
            values[a] = known.get(number, values[a])
            outputs[number][nonzero] = values[a]
        elif code == ca.OP_CONST:
            values[k] = constant(own.data[k])
        elif code == ENTRY:
            entry = own.data[k]
            values[k] = constant(0.0) if entry is None else operation(entry, (values[a], values[b]))
        else:
            raise DeclarationError(f"Function '{f.name()}' calls another Function. Build it without never_inline.")
        # Values that are not needed any more are dropped, because they may be large.
        if last[a] == k:
            values[a] = None
        if last[b] == k:
            values[b] = None
    return outputs
