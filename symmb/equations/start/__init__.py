"""Consistent starts: positions, velocities and equilibria that satisfy the constraints.

`preparation` makes the start of a scene, and `start` is the map from parameters to states that results. `assembly` and
`gauss_newton` solve for the nominal positions, `implicit_function` for those of each sample, `velocities` for
velocities and `equilibrium` for equilibria. `rank` determines the rank of the constraints at the nominal start.
`joint_start` and `joint_values` do the same in joint coordinates.
"""

from symmb.equations.start.joint_start import start_in_joints
from symmb.equations.start.preparation import prepare_start, with_gated_rows
from symmb.equations.start.rank import independent_rows_and_columns
from symmb.equations.start.singularity import Singularity, singularity
from symmb.equations.start.start import Start
