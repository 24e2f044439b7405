"""Parameters, bodies, points, joints, forces and contacts, as users declare them.

All are frozen values. The package `symmb.equations` derives the equations of motion.
"""

from symmb._doors import open_door

open_door(__name__)
