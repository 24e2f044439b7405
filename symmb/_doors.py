"""Doors: the `__init__.py` of a room loads a module of the room when one of its names is first used.

A first simulation needs a third of the modules. The names that other rooms use are listed in `__init__.pyi`, which is
also what type checkers read. Where only some scenes need another room, its names are used as `room.Name`, after
`from symmb.wing import room`: the modules of that room are loaded by the scenes that need them.
"""

import re
import sys
from importlib import import_module
from types import ModuleType
from typing import Any


def homes(file: str) -> dict[str, str]:
    """The names that are listed in the `__init__.pyi` beside a file `__init__.py`, and the module of each name."""
    with open(f"{file}i", encoding="utf-8") as stub:
        lists = re.findall(r"^from (\.\S+) import (\([^)]*\)|.*)$", stub.read(), flags=re.MULTILINE)
    return {name: module for module, names in lists for name in re.findall(r" as (\w+)", names)}


def open_door(package: str) -> None:
    """Load the modules of a room at the first use of their names. `__init__.py` calls this function."""
    room = sys.modules[package]
    room.__dict__["_homes"] = names = homes(str(room.__file__))
    room.__dict__["__all__"] = [*names]
    room.__class__ = Door


class Door(ModuleType):
    """A room whose names are loaded at their first use."""

    _homes: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        if name not in self._homes:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}", name=name, obj=self)
        value = getattr(import_module(self._homes[name], self.__name__), name)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute, but keep the function `sweep` when the import system sets the module `sweep`."""
        if name not in self._homes or not isinstance(value, ModuleType):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return [*{*super().__dir__(), *self._homes}]
