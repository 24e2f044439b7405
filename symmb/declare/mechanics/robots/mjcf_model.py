"""A model of MuJoCo: names of its parts, and the parts of the physics that are switched off."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from symmb._errors import DeclarationError
from symmb._names import name_fault

_CONSTRAINTS = "CONTACT", "EQUALITY", "FRICTIONLOSS", "LIMIT"
"""Parts of the physics that MuJoCo's constraint solver computes."""


def values_of(array: Any) -> tuple[Any, ...]:
    """A NumPy array as a tuple of Python numbers."""
    return tuple(array.tolist())


@dataclass(frozen=True, eq=False)
class MjcfModel:
    """A compiled `mujoco.MjModel`, the package mujoco, the file, and the impossible moments of inertia by body."""

    model: Any
    mujoco: Any
    path: Path
    moments: Mapping[int, tuple[float, ...]]

    def acts(self, what: str) -> bool:
        """Whether a part of the physics is switched on. `what` is its name in mjtDisableBit."""
        bits = [what, "CONSTRAINT"] if what in _CONSTRAINTS else [what]
        off = sum(int(getattr(self.mujoco.mjtDisableBit, f"mjDSBL_{bit}")) for bit in bits)
        return not self.model.opt.disableflags & off

    def kind(self, enum: str, value: Any) -> str:
        """The last word of the name of a value of an enumeration, such as "JOINT" for mjTRN_JOINT."""
        return getattr(self.mujoco, enum)(int(value)).name.rpartition("_")[2]

    @cached_property
    def bodies(self) -> list[str]:
        """Names of all bodies, the world first."""
        return self._names("body", self.model.nbody)

    @cached_property
    def joints(self) -> list[str]:
        """Names of all joints."""
        return self._names("joint", self.model.njnt)

    @cached_property
    def tendons(self) -> list[str]:
        """Names of all tendons."""
        return self._free_names("tendon", self.model.ntendon, {*self.bodies, *self.joints})

    @cached_property
    def actuators(self) -> list[str]:
        """Names of all actuators."""
        count = getattr(self.model, "nactuator", self.model.nu)  # before MuJoCo 4 each actuator had one control
        return self._free_names("actuator", count, {*self.bodies, *self.joints, *self.tendons})

    @cached_property
    def equalities(self) -> list[str]:
        """Names of all equality constraints."""
        taken = {*self.bodies, *self.joints, *self.tendons, *self.actuators}
        return self._free_names("equality", self.model.neq, taken)

    def _names(self, kind: str, count: int) -> list[str]:
        """Unique names of the parts of a kind. Spaces, dots and brackets become _. A missing name becomes "joint2"."""
        own = [re.sub(r"[\s.\[\]]", "_", getattr(self.model, kind)(k).name) for k in range(count)]
        for name in filter(None, own):
            if fault := name_fault(name):
                raise DeclarationError(f"{self.path}: the {kind} name {name!r} cannot be used, because {fault}")
        taken: set[str] = set()
        given = [name and _free(name, "_", taken) for name in own]
        return [name or _free(f"{kind}{k}", "_", taken) for k, name in enumerate(given)]

    def _free_names(self, kind: str, count: int, taken: set[str]) -> list[str]:
        """Names of the parts of a kind. If another part has the same name, the kind is added to the name."""
        return [_free(name, f"_{kind}", taken) for name in self._names(kind, count)]

    def mesh_file(self, mesh: int) -> str:
        """The path of a mesh's file relative to the model's folder; empty if the model itself contains the mesh."""
        start = int(self.model.mesh_pathadr[mesh])
        return "" if start < 0 else self.model.paths[start:].split(b"\0", 1)[0].decode()


def _free(name: str, end: str, taken: set[str]) -> str:
    """The name, with endings added until it is unique. The result is added to `taken`."""
    while name in taken:
        name += end
    taken.add(name)
    return name
