"""From a declaration to equations: System, Scene, and DAE, the compiled equations for solvers.

`validation` and `assembly` check declarations, and report all faults at once. `tolerance_list` and `iso_grades` read
tolerances for `Box`, and `choices` its finite sets and its constraints.
"""

from symmb.equations.model.box import Box, require_only_intervals
from symmb.equations.model.choices import Choice, chosen_words, excess, hint, require_numbers_of_words
from symmb.equations.model.compilation import compile_dae
from symmb.equations.model.contact_equations import Impacts, JointEvents
from symmb.equations.model.dae import DAE, is_linear
from symmb.equations.model.joint_space import JointSpace
from symmb.equations.model.lazy import Lazy
from symmb.equations.model.scales import Scales
from symmb.equations.model.scene import Scene
from symmb.equations.model.start_values import JointValue, Prescribed
from symmb.equations.model.system import System
from symmb.equations.model.tolerance_list import share_of
from symmb.equations.model.units import units_of
from symmb.equations.model.unused_parameters import unused_parameters, with_some_outputs
from symmb.equations.model.validation import left_out
