"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .boxes import Enclosure as Enclosure, enclose as enclose
from .interval import Interval as Interval, operate as operate, parameter_intervals as parameter_intervals
from .outputs import EXTRA_NODES as EXTRA_NODES
from .problem import SINGULAR as SINGULAR, Problem as Problem
from .rounding import require_rounding_to_nearest as require_rounding_to_nearest
from .scene_problem import problem_of as problem_of
from .start import NO_START as NO_START
