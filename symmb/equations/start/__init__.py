"""Consistent starts: positions, velocities and equilibria that satisfy the constraints.

The rank of the constraints is determined at the start of the nominal scene.
"""

from symmb.equations.start.joint_start import start_in_joints
from symmb.equations.start.preparation import prepare_start, with_gated_rows
from symmb.equations.start.rank import independent_rows_and_columns
from symmb.equations.start.singularity import Singularity, singularity
from symmb.equations.start.start import Start
