"""Finite elements of flexible bodies and their reduction to modes.

A structure is reduced to `Modes`, the input of `mechanics.FlexibleBody`.
"""

from symmb._doors import open_door

open_door(__name__)
