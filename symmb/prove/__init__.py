"""Proved enclosures of the motions of mechanisms over a box of parameters.

Over each step, a motion is a Chebyshev polynomial of time and of the parameters, plus a remainder B w. The matrix B is
the frame of the remainder. The polynomial is computed without proof. Bounds of w are proved afterwards.

- `boxes` encloses the motions of the whole box. `march` proves them over all times, step by step.
- `front` and `start` contain the states at one time. `flow` computes the polynomials of a step.
- `step` proves bounds of the errors of these polynomials from the `defects`. `time_step` contains the polynomials.
- `passes` proves motions in the short time in which they pass a switch, for all parameters of the box.
- `outputs` bounds the outputs over a step.
- `orders` chooses the orders of many parameters. `terms` and `basis` contain their polynomials.
- `stiff` makes the frames of stiff steps.
- `scene_problem` makes the equations of a scene. `modes` makes equations for frequencies and limits of stability.
- `interval`, `discs`, `points`, `taylor_models` and `chebyshev` are arithmetics with bounds of rounding errors.
"""

from symmb._doors import open_door

open_door(__name__)
