"""Proved enclosures of the motions of mechanisms over a box of parameters.

Over each step, a motion is a Chebyshev polynomial of time and of the parameters, plus a remainder in a frame. The
polynomial is computed without proof. The remainder is proved afterwards.

- `boxes` proves the whole box, and `march` the horizon, step by step. `front` and `start` hold the states at one time.
- `flow` computes the polynomials of a step, `time_step` holds them, and `step` proves the bounds of their errors from
  the `defects`. `passes` proves the time windows in which the box passes a switch.
- `outputs` bounds the outputs over a step.
- `scene_problem` makes the equations of a scene, and `modes` those of frequencies and limits of stability.
- `interval`, `discs`, `points`, `taylor_models` and `chebyshev` are arithmetics with bounds of rounding errors.
"""

from symmb.prove.boxes import Enclosure, enclose
from symmb.prove.interval import Interval, operate, parameter_intervals
from symmb.prove.outputs import EXTRA_NODES
from symmb.prove.problem import SINGULAR, Problem
from symmb.prove.scene_problem import problem_of
from symmb.prove.start import NO_START
