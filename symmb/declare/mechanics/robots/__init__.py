"""Machines from URDF and MJCF files: the content of the files, and the bodies and joints that it describes."""

from symmb.declare.mechanics.robots.mjcf_file import load_mjcf
from symmb.declare.mechanics.robots.robot import LinkFrame, Robot
from symmb.declare.mechanics.robots.urdf_file import load_urdf
