"""Consistent starts: positions, velocities and equilibria that satisfy the constraints.

`preparation` computes the start of a scene. `start` has the result, a map from parameters to states. `assembly` and
`gauss_newton` solve for the nominal positions, and `implicit_function` for the positions of each sample. `velocities`
computes velocities, and `equilibrium` computes equilibria. `rank` determines the rank of the constraints at the nominal
start. `joint_start` and `joint_values` compute starts in joint coordinates.
"""

from symmb._doors import open_door

open_door(__name__)
