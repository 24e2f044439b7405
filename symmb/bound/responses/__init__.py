"""Runs over a box, and what is known of their responses.

In:   a simulator, a box, and points of the box.
Out:  responses (N, n_t, n_y), their extremes and the runs that attain them, failed runs, and polynomials or samples.

`RunsOverBox` in `box_runs` makes the runs of a method. `streams` reduces runs block by block. `failures` describes
where runs fail, `worst_case` has the runs at extremes, `time_windows` decides whether an error is doubtful, and `trace`
lists the rules that decide errors.
"""

from symmb._doors import open_door

open_door(__name__)
