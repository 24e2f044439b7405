"""Machines from URDF and MJCF files: the content of the files, and the bodies and joints in the files.

`urdf_file` with `document`, and `mjcf_file` with `mjcf_model`, `mjcf_elements` and `mjcf_left_out` read files. `robot`
makes machines of a `description`. `repair` changes moments of inertia. `algebra` has vectors of numbers or expressions.
"""

from symmb._doors import open_door

open_door(__name__)
