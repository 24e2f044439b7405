"""Parameters, bodies, points, joints, forces and contacts, as users declare them.

All are frozen values. The package `symmb.equations` derives the equations of motion.
"""

from symmb.declare.mechanics.actuator import Actuator, Stop
from symmb.declare.mechanics.axis_joint import AxisJoint, Joint
from symmb.declare.mechanics.body import (
    TRIANGLE,
    AbstractBody,
    Body,
    Flywheel,
    Ground,
    Inertial,
    Link,
    Point,
    as_matrix,
    inertia_matrix,
)
from symmb.declare.mechanics.clutch import Clutch, Sticks, Struck
from symmb.declare.mechanics.constraint import Constraint, Motion, VelocityConstraint
from symmb.declare.mechanics.contact import BushContact, Contact, ToothContact, TorsionContact
from symmb.declare.mechanics.curve import Curve
from symmb.declare.mechanics.curve_contact import CurveContact, PointOnCurve
from symmb.declare.mechanics.declaration import FilledByBlock, in_no_system, mark_as_used
from symmb.declare.mechanics.element import Element, law_value, positive_numbers
from symmb.declare.mechanics.figure import Figure, maximum, mean
from symmb.declare.mechanics.flexible_body import FlexibleBody
from symmb.declare.mechanics.force import (
    Action,
    Bushing,
    Force,
    ForceElement,
    Gravity,
    Load,
    SpringDamper,
    Torque,
    TorsionSpring,
)
from symmb.declare.mechanics.friction import Friction
from symmb.declare.mechanics.geometry import Mesh
from symmb.declare.mechanics.impact import RESTITUTION, Impact
from symmb.declare.mechanics.joint import (
    CamFollower,
    Cylindrical,
    Distance,
    Gear,
    PlanarJoint,
    PointOnLine,
    Prismatic,
    Revolute,
    Screw,
    Spherical,
    Universal,
    Weld,
)
from symmb.declare.mechanics.joint_coordinates import AXIS, JointCoordinates, RelativePose, quaternion_of
from symmb.declare.mechanics.joint_event import JointEvent, Latch, closed_at_start, row_gates
from symmb.declare.mechanics.load import GasSpring, NonlinearSpring, Orifice, Soil
from symmb.declare.mechanics.mesh_file import coarser
from symmb.declare.mechanics.motor import Motor
from symmb.declare.mechanics.parameter import Parameters, declared_with, with_si_symbols
from symmb.declare.mechanics.pose import Frame, Particle, Planar, Spatial
from symmb.declare.mechanics.random_input import LEVELS, RandomInput
from symmb.declare.mechanics.rope import Rope
from symmb.declare.mechanics.rotation import Rotation, rotation
from symmb.declare.mechanics.shape_contact import BoxContact, CircleContact, SlotContact, SphereContact
from symmb.declare.mechanics.state import Input, OwnState, Sampled, State, States
