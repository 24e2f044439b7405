"""Finite elements of flexible bodies and their reduction to modes.

A structure becomes `Modes`, which `mechanics.FlexibleBody` takes.
"""

from symmb.structures.flexibility import Responses
from symmb.structures.inertia_invariants import Invariants
from symmb.structures.modes import Modes
