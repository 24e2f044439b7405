"""Consistent starts: positions, velocities and equilibria that satisfy the constraints.

The rank of the constraints is decided here, at the start of the nominal scene.
"""

from symmb.start.rank import Singularity, independent, singularity
from symmb.start.start import Start, prepare_start
