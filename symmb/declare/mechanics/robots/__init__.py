"""Machines from files: what URDF and MJCF files say, and the bodies and joints made of it."""

from symmb.declare.mechanics.robots.mjcf_file import load_mjcf
from symmb.declare.mechanics.robots.robot import LinkFrame, Robot
from symmb.declare.mechanics.robots.urdf_file import load_urdf
