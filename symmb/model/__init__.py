"""From a declaration to equations: System, Scene, and the DAE bundle that solvers get.

Declarations are checked here, and all faults are reported at once.
"""

from symmb.model.box import Box
from symmb.model.compilation import compile_dae
from symmb.model.contact_equations import Impacts, JointEvents
from symmb.model.dae import DAE, is_linear
from symmb.model.joint_space import JointSpace
from symmb.model.lazy import Lazy
from symmb.model.scales import Scales
from symmb.model.scene import Scene
from symmb.model.start_values import JointValue, Prescribed
from symmb.model.system import System
from symmb.model.units import units_of
from symmb.model.unused_parameters import unused_parameters
