"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .examination import (
    Drift as Drift,
    Energy as Energy,
    Examination as Examination,
    drift as drift,
    energy as energy,
    work_of as work_of,
)
from .linear_theory import deformation_doubts as deformation_doubts, linear_theory_doubts as linear_theory_doubts
from .missing_modes import AttachedLoads as AttachedLoads, attached_loads as attached_loads, with_loads as with_loads
from .two_ways import OtherWays as OtherWays, TwoWays as TwoWays, in_two_ways as in_two_ways, other_way as other_way
