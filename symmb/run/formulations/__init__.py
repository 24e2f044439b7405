"""The coordinates in which a scene runs, and the program that runs its samples with a solver.

A Formulation has equations, start and outputs in the same coordinates. A Program has formulations, a solver and times.
"""

from symmb._doors import open_door

open_door(__name__)
