"""The fixed C of the folder c."""

from pathlib import Path

C_FOLDER = Path(__file__).parent / "c"


def c_source(name: str) -> str:
    """The text of one C header in the folder c, named without its suffix."""
    return (C_FOLDER / f"{name}.h").read_text(encoding="utf-8")
