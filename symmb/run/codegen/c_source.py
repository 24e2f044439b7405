"""The text of the C files in the folder c."""

import ctypes
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

C_FOLDER = Path(__file__).parent / "c"


def c_source(*names: str) -> str:
    """The texts of C headers of the folder c, in the order of `names`. Names are given without suffix.

    Lines that include other headers are left out, because a generated source contains each file once. The source has
    its own model instead of the example in model.h.
    """
    texts = [(C_FOLDER / f"{name}.h").read_text(encoding="utf-8") for name in names]
    return "\n".join(line for text in texts for line in text.splitlines() if not line.startswith('#include "'))


def c_number(name: str, constant: str) -> float:
    """The value of `#define constant value` in a header of the folder c. Python and C share such numbers."""
    (value,) = re.findall(rf"^#define {constant} (\S+)", (C_FOLDER / f"{name}.h").read_text(encoding="utf-8"), re.M)
    return float(value)


def c_fields(*groups: tuple[type, str]) -> list[tuple[str, type]]:
    """The fields of a ctypes.Structure from their types and names, in the order of the struct in C."""
    return [(name, kind) for kind, names in groups for name in names.split()]


Tables = tuple[ctypes.Structure, Sequence[np.ndarray]]
"""A structure of C with its numbers, and the arrays to which it points."""
_TYPES = {"d": "double", "f": "float", "i": "int", "l": "long"}


def c_tables(kind: str, name: str, tables: Tables) -> str:
    """C definitions of a constant structure `name` of the type `kind`, and of the arrays to which it points."""
    structure, arrays = tables
    names, lines = dict[int, str](), list[str]()
    for k, array in enumerate(arrays):
        names[array.ctypes.data] = f"{name}_{k}"
        values = ",".join(map(repr, array.ravel().tolist() or [0]))
        lines.append(f"static const {_TYPES[array.dtype.char]} {name}_{k}[] = {{{values}}};")

    def text(value: object) -> str:
        if isinstance(value, ctypes.Array):
            return f"{{{', '.join(map(text, value))}}}"
        return names.get(value, repr(value)) if isinstance(value, int) else repr(value)

    fields = ", ".join(f".{field[0]} = {text(getattr(structure, field[0]))}" for field in structure._fields_)
    return "\n".join([*lines, f"static const {kind} {name} = {{{fields}}};"])
