"""Proved enclosures of the motions of mechanisms over a box of parameters.

Over each step, a motion is a Chebyshev polynomial of time and of the parameters, plus a remainder in a frame. The
polynomial is computed without proof. The remainder is proved afterwards.
"""

from symmb.prove.boxes import Enclosure, enclose
from symmb.prove.interval import Interval, operate, parameter_intervals
from symmb.prove.outputs import EXTRA_NODES
from symmb.prove.problem import SINGULAR, Problem
from symmb.prove.scene_problem import problem_of
from symmb.prove.start import NO_START
