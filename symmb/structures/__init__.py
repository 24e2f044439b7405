"""Finite elements of flexible bodies and their reduction to modes, in numbers.

A structure becomes `Modes`, which `mechanics.FlexibleBody` takes.
"""

from symmb.structures.beams import Beam
from symmb.structures.finite_elements import FiniteElements
from symmb.structures.modes import Modes
from symmb.structures.section import Material, Section
