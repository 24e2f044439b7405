"""The instructions of an SX Function, prepared for many runs with numbers of any kind."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from symmb.declare.symbolic import entries_of, operation_name

_INPUT, _OUTPUT, _CONSTANT, _UNARY, _BINARY, _ENTRIES = range(6)


class Tape:
    """Scalar instructions of an SX Function with dense outputs."""

    def __init__(self, f: ca.Function) -> None:
        self.sizes = [f.numel_out(i) for i in range(f.n_out())]
        self._slots, self._steps, self._codes = f.sz_w(), [], set()
        nodes: Any = f.instructions_sx()
        for k in range(f.n_instructions()):
            code, a, out = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
            if code == ca.OP_INPUT:
                self._steps.append((_INPUT, out[0], a[0], a[1], None))
            elif code == ca.OP_OUTPUT:
                self._steps.append((_OUTPUT, out[0], out[1], a[0], None))
            elif code == ca.OP_CONST:
                self._steps.append((_CONSTANT, out[0], 0, 0, f.instruction_constant(k)))
            elif code == ca.OP_CALL and (entries := entries_of(nodes[k].which_function(), len(out))):
                self._codes |= {code}
                used = [(entry, place) for entry, place in zip(entries, out, strict=True) if place >= 0]
                self._steps.append((_ENTRIES, 0, a[0], a[1], used))
            else:
                self._codes.add(code)
                kind = _UNARY if len(a) == 1 else _BINARY
                self._steps.append((kind, out[0], a[0], a[-1], code))

    def unknown(self, operations: Mapping[int, object]) -> list[str]:
        """Sorted names of the operations that `operations` does not contain."""
        return sorted(operation_name(code) for code in self._codes if code not in operations)

    def first(
        self,
        operations: Mapping[int, Callable[..., Any]],
        constant: Callable[[float], Any],
        inputs: Sequence[Sequence[Any]],
        is_lost: Callable[[Any], bool],
    ) -> str:
        """The name of the first operation with a result for which `is_lost` is True; empty if there is none."""
        lost: list[int] = []

        def watched(code: int) -> Callable[..., Any]:
            def operation(*arguments: Any) -> Any:
                result = operations[code](*arguments)
                if not lost and is_lost(result):
                    lost.append(code)
                return result

            return operation

        self.run({code: watched(code) for code in self._codes}, constant, inputs)
        return operation_name(lost[0]) if lost else ""

    def run(
        self,
        operations: Mapping[int, Callable[..., Any]],
        constant: Callable[[float], Any],
        inputs: Sequence[Sequence[Any]],
    ) -> list[list[Any]]:
        """The outputs as lists of elements. Each input is a sequence of elements."""
        work: list[Any] = [None] * self._slots
        outputs = [[None] * size for size in self.sizes]
        for kind, out, a, b, code in self._steps:
            if kind == _BINARY:
                work[out] = operations[code](work[a], work[b])
            elif kind == _ENTRIES:  # results may take the places of arguments
                group, at = work[a], work[b]
                for entry, place in code:
                    work[place] = operations[ca.OP_CALL](entry, group, at) if entry else constant(0.0)
            elif kind == _UNARY:
                work[out] = operations[code](work[a])
            elif kind == _CONSTANT:
                work[out] = constant(code)
            elif kind == _INPUT:
                work[out] = inputs[a][b]
            else:
                outputs[out][a] = work[b]
        return outputs


def operations_by_sides(
    subtract: Callable[..., Any],
    negative: Callable[[Any], Any],
    side: Callable[[Any], float],
    is_zero: Callable[[Any], bool],
    number: Callable[[float], Any],
) -> dict[int, Callable[..., Any]]:
    """CasADi's operations that depend only on the signs of numbers.

    Parameters
    ----------
    side : 1 or -1, or nan if a number may be on both sides
    is_zero : whether a number is exactly 0
    number : makes a number from a value; nan stands for any number
    """

    def chosen(where: float, positive: Any, other: Any) -> Any:
        return number(where) if where != where else positive if where > 0 else other

    def of_difference(value: Callable[[float], float]) -> Callable[..., Any]:
        return lambda a, b: number(value(side(subtract(a, b))))

    def holds(condition: Any) -> float:
        return 0.0 if is_zero(condition) else abs(side(condition))

    return {
        ca.OP_FABS: lambda a: chosen(side(a), a, negative(a)),
        ca.OP_SIGN: lambda a: number(side(a)),
        ca.OP_FMIN: lambda a, b: chosen(side(subtract(a, b)), b, a),
        ca.OP_FMAX: lambda a, b: chosen(side(subtract(a, b)), a, b),
        ca.OP_LT: of_difference(lambda s: 0.5 - 0.5 * s),
        ca.OP_LE: of_difference(lambda s: 0.5 - 0.5 * s),
        ca.OP_EQ: of_difference(lambda s: 0.0 * abs(s)),
        ca.OP_NE: of_difference(abs),
        ca.OP_NOT: lambda a: number(1.0 - holds(a)),
        ca.OP_AND: lambda a, b: number(holds(a) * holds(b)),
        ca.OP_OR: lambda a, b: number(1.0 - (1.0 - holds(a)) * (1.0 - holds(b))),
        ca.OP_IF_ELSE_ZERO: lambda condition, a: chosen(2.0 * holds(condition) - 1.0, a, number(0.0)),
    }
