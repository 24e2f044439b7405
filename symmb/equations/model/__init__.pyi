"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .box import Box as Box, require_only_intervals as require_only_intervals
from .c_export import example_c as example_c, save_c as save_c
from .choices import (
    Choice as Choice,
    chosen_words as chosen_words,
    excess as excess,
    hint as hint,
    require_numbers_of_words as require_numbers_of_words,
)
from .compilation import compile_dae as compile_dae
from .contact_equations import ContactEquations as ContactEquations, Impacts as Impacts, JointEvents as JointEvents
from .dae import DAE as DAE, LAST_ENGINE as LAST_ENGINE, is_linear as is_linear
from .figures import BoundFigure as BoundFigure, bound_figure as bound_figure
from .joint_space import JointSpace as JointSpace
from .lazy import Lazy as Lazy
from .multipliers import Reaction as Reaction, reaction as reaction
from .restart import EndedRun as EndedRun, Restart as Restart, restart_of as restart_of
from .scales import Scales as Scales
from .scene import Scene as Scene
from .start_values import JointValue as JointValue, Prescribed as Prescribed
from .summary import system_text as system_text
from .system import System as System
from .tolerance_list import share_of as share_of
from .uncertainty_file import records_in_file as records_in_file
from .units import units_of as units_of
from .unused_parameters import unused_parameters as unused_parameters, with_some_outputs as with_some_outputs
from .validation import left_out as left_out
