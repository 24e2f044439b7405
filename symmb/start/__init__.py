"""Consistent starts: positions, velocities and equilibria that satisfy the constraints.

The rank of the constraints is decided here, at the start of the nominal scene.
"""

from symmb.start.joint_start import start_in_joints
from symmb.start.preparation import prepare_start, with_gated_rows
from symmb.start.rank import independent_rows_and_columns
from symmb.start.singularity import Singularity, singularity
from symmb.start.start import Start
