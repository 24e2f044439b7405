"""Symbolic multibody dynamics with interval parameters.

Declare bodies, joints and forces. symmb derives the equations, compiles them, runs them and bounds the results. Write
`import symmb as mb`, and `help(mb.Body)` for help on one name. `symmb --help` says where the guide is. The public
names by subject:
"""

# The public names are listed in `__init__.pyi`. Each module is loaded when one of its names is first used.

from importlib import import_module
from textwrap import fill
from typing import Any

from symmb._doors import homes
from symmb._names import did_you_mean, public_names

_homes = homes(__file__)
__all__ = [*_homes]  # pyright: ignore[reportUnsupportedDunderAll]
for _subject, _names in public_names().items():
    __doc__ = f"{__doc__}\n{_subject}\n{fill(', '.join(_names), 116, initial_indent='    ', subsequent_indent='    ')}"


def __dir__() -> list[str]:
    return [*__all__, "__citation__", "__version__", "models"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # this import takes as long as all other imports together

        return version("symmb")
    if name == "__citation__":
        return import_module("symmb._citation").citation()
    if name == "models":
        return import_module("symmb.models")
    if name in _homes:
        value = globals()[name] = getattr(import_module(_homes[name], __name__), name)
        return value
    known = "" if name.startswith("_") else did_you_mean(name, __all__)
    raise AttributeError(f"symmb has no name {name!r}.{known}", name=name)
