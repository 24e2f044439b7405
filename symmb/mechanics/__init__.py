"""What a user declares: parameters, bodies, points, joints, forces, contacts.

All are frozen values; equations are derived in `model`.
"""

from symmb.mechanics.actuator import Actuator, Stop
from symmb.mechanics.axis_joint import AxisJoint, Joint
from symmb.mechanics.body import AbstractBody, Body, Flywheel, Ground, Inertial, Point, as_matrix, inertia_matrix
from symmb.mechanics.clutch import Clutch, Sticks, Struck
from symmb.mechanics.constraint import Constraint, Motion, VelocityConstraint
from symmb.mechanics.contact import BushContact, Contact, ToothContact, TorsionContact
from symmb.mechanics.curve import Curve
from symmb.mechanics.curve_contact import CurveContact, PointOnCurve
from symmb.mechanics.declaration import Block
from symmb.mechanics.element import Element, law_value
from symmb.mechanics.figure import Figure, maximum, mean
from symmb.mechanics.flexible_body import FlexibleBody
from symmb.mechanics.force import (
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
from symmb.mechanics.friction import Friction
from symmb.mechanics.geometry import Mesh
from symmb.mechanics.impact import RESTITUTION, Impact
from symmb.mechanics.input import Input
from symmb.mechanics.joint import (
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
from symmb.mechanics.joint_coordinates import AXIS, JointCoordinates, RelativePose, quaternion_of
from symmb.mechanics.joint_event import JointEvent, Latch, closed_at_start, row_gates
from symmb.mechanics.load import GasSpring, NonlinearSpring, Orifice, Soil
from symmb.mechanics.mesh_file import coarser
from symmb.mechanics.motor import Motor
from symmb.mechanics.parameter import Parameters, declared_with, with_si_symbols
from symmb.mechanics.pose import Frame, Particle, Planar, Spatial
from symmb.mechanics.rope import Rope
from symmb.mechanics.rotation import Rotation, rotation
from symmb.mechanics.sampled import Sampled
from symmb.mechanics.shape_contact import BoxContact, CircleContact, SlotContact, SphereContact
from symmb.mechanics.state import OwnState, State
