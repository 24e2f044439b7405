"""What a user declares: parameters, bodies, points, joints, forces, contacts.

All are frozen values; equations are derived in `model`.
"""

from symmb.mechanics.body import AbstractBody, Body, Ground, Inertial, Point, as_matrix, inertia_matrix
from symmb.mechanics.constraint import Constraint
from symmb.mechanics.element import Element
from symmb.mechanics.force import Action, ForceElement, Gravity, Load
from symmb.mechanics.impact import RESTITUTION, Impact
from symmb.mechanics.joint import AxisJoint, Joint, Weld
from symmb.mechanics.parameter import Parameters
from symmb.mechanics.pose import Particle, Planar, Spatial
from symmb.mechanics.rotation import Rotation, rotation
