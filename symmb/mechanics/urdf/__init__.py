"""Machines from URDF files: the XML with its lines, what it says, and the bodies and joints made of it."""

from symmb.mechanics.urdf.robot import LinkFrame, Robot, load_urdf
