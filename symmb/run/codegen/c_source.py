"""The text of the C files in the folder c."""

import re
from pathlib import Path

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
