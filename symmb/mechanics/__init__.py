"""What a user declares: parameters, bodies, points, joints, forces, contacts.

All are frozen values; equations are derived in `model`.
"""

from symmb.mechanics.body import AbstractBody, Body, Ground, Inertial, Point, as_matrix, inertia_matrix
from symmb.mechanics.constraint import (
    AxisJoint,
    Constraint,
    Cylindrical,
    Distance,
    Gear,
    Joint,
    Motion,
    PlanarJoint,
    PointOnLine,
    Prismatic,
    Revolute,
    Screw,
    Spherical,
    Universal,
    VelocityConstraint,
    Weld,
)
from symmb.mechanics.contact import BushContact, Contact, ToothContact, TorsionContact
from symmb.mechanics.contact_law import Flores, HuntCrossley, KelvinVoigt, LankaraniNikravesh, Tabulated
from symmb.mechanics.element import Element
from symmb.mechanics.flexible_body import FlexibleBody
from symmb.mechanics.force import (
    Action,
    Bushing,
    Damper,
    Force,
    ForceElement,
    Gravity,
    Load,
    Spring,
    SpringDamper,
    Torque,
    TorsionSpring,
)
from symmb.mechanics.friction import Bristle, Coulomb, Friction
from symmb.mechanics.impact import RESTITUTION, Impact
from symmb.mechanics.load import GasSpring, NonlinearSpring, Orifice, Soil
from symmb.mechanics.parameter import Parameters
from symmb.mechanics.pose import Particle, Planar, Spatial
from symmb.mechanics.rotation import Rotation, rotation
from symmb.mechanics.table import Table
