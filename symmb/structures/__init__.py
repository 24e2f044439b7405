"""Finite elements of flexible bodies and their reduction to modes.

A structure becomes `Modes`, which `mechanics.FlexibleBody` takes.
"""

from symmb.structures.flexibility import Responses
from symmb.structures.modes import Invariants, Modes
