"""Finite elements of flexible bodies and their reduction to modes.

A structure is reduced to `Modes`, the input of `mechanics.FlexibleBody`.
"""

from symmb.declare.structures.flexibility import Responses
from symmb.declare.structures.inertia_invariants import Invariants
from symmb.declare.structures.modes import Modes
