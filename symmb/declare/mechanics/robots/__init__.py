"""Machines from URDF and MJCF files: the content of the files, and the bodies and joints in the files.

`urdf_file` with `document`, and `mjcf_file` with `mjcf_model`, `mjcf_elements` and `mjcf_left_out` read files. `robot`
makes machines of a `description`. `repair` changes moments of inertia. `algebra` has vectors of numbers or expressions.
"""

from symmb.declare.mechanics.robots.document import Tag, read_document
from symmb.declare.mechanics.robots.mjcf_file import load_mjcf
from symmb.declare.mechanics.robots.robot import LinkFrame, Robot
from symmb.declare.mechanics.robots.urdf_file import load_urdf
