"""Evaluation of the instructions of a CasADi SX Function with any number type.

CasADi evaluates an SX Function as a flat list of scalar instructions on a work vector. In `interpret`, the caller
defines the operations. SymPy expressions in place of numbers give an export to SymPy. Intervals give an interval
evaluation, and names of variables give C code.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeVar

import casadi as ca

from symmb._errors import DeclarationError
from symmb.declare.symbolic.pieces import Entry, called

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
    # Every element of `work` is written before it is read, so its initial value has no effect.
    work = [constant(0.0)] * f.sz_w()
    outputs = [[constant(0.0)] * f.nnz_out(i) for i in range(f.n_out())]
    calls = called(f)
    for k in range(f.n_instructions()):
        code, arguments, results = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if code == ca.OP_INPUT:
            work[results[0]] = inputs[arguments[0]][arguments[1]]
        elif code == ca.OP_OUTPUT:
            work[arguments[0]] = known.get(results[0], work[arguments[0]])
            outputs[results[0]][results[1]] = work[arguments[0]]
        elif code == ca.OP_CONST:
            work[results[0]] = constant(f.instruction_constant(k))
        elif k in calls:
            of = tuple(work[i] for i in arguments[:2])
            for entry, place in zip(calls[k], results, strict=True):
                if place >= 0:  # other results are not used
                    work[place] = constant(0.0) if entry is None else operation(entry, of)
        elif code == ca.OP_CALL:
            raise DeclarationError(f"Function '{f.name()}' calls another Function. Build it without never_inline.")
        else:
            work[results[0]] = operation(code, tuple(work[i] for i in arguments))
    return outputs
