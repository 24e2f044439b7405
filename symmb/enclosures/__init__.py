"""Proved enclosures of the motions of mechanisms over a box of parameters.

A motion is a Chebyshev polynomial of time and of the parameters over each step, computed without proof, plus a
remainder in a frame, which is proved afterwards.
"""

from symmb.enclosures.boxes import Enclosure, enclose
from symmb.enclosures.outputs import EXTRA_NODES
from symmb.enclosures.problem import SINGULAR, Problem
from symmb.enclosures.scene_problem import problem_of
from symmb.enclosures.start import NO_START
