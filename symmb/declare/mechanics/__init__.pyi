"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .actuator import Actuator as Actuator, Stop as Stop
from .axis_joint import AxisJoint as AxisJoint, Joint as Joint
from .body import (
    TRIANGLE as TRIANGLE,
    AbstractBody as AbstractBody,
    Body as Body,
    Flywheel as Flywheel,
    Ground as Ground,
    Inertial as Inertial,
    Link as Link,
    Point as Point,
    as_matrix as as_matrix,
    inertia_matrix as inertia_matrix,
    is_flexible as is_flexible,
)
from .clutch import Clutch as Clutch, Sticks as Sticks, Struck as Struck
from .constraint import Constraint as Constraint, Motion as Motion, VelocityConstraint as VelocityConstraint
from .contact import (
    BushContact as BushContact,
    Contact as Contact,
    ToothContact as ToothContact,
    TorsionContact as TorsionContact,
)
from .curve import Curve as Curve
from .curve_contact import CurveContact as CurveContact, PointOnCurve as PointOnCurve
from .declaration import FilledByBlock as FilledByBlock, in_no_system as in_no_system, mark_as_used as mark_as_used
from .element import Element as Element, law_value as law_value, positive_numbers as positive_numbers
from .figure import Figure as Figure, maximum as maximum, mean as mean
from .flexible_body import FlexibleBody as FlexibleBody
from .force import (
    Action as Action,
    Bushing as Bushing,
    Force as Force,
    ForceElement as ForceElement,
    Gravity as Gravity,
    Load as Load,
    SpringDamper as SpringDamper,
    Torque as Torque,
    TorsionSpring as TorsionSpring,
)
from .friction import Friction as Friction
from .geometry import Mesh as Mesh
from .impact import RESTITUTION as RESTITUTION, Impact as Impact
from .joint import (
    CamFollower as CamFollower,
    Cylindrical as Cylindrical,
    Distance as Distance,
    Gear as Gear,
    PlanarJoint as PlanarJoint,
    PointOnLine as PointOnLine,
    Prismatic as Prismatic,
    Revolute as Revolute,
    Screw as Screw,
    Spherical as Spherical,
    Universal as Universal,
    Weld as Weld,
)
from .joint_coordinates import (
    AXIS as AXIS,
    JointCoordinates as JointCoordinates,
    RelativePose as RelativePose,
    quaternion_of as quaternion_of,
)
from .joint_event import (
    JointEvent as JointEvent,
    Latch as Latch,
    closed_at_start as closed_at_start,
    row_gates as row_gates,
)
from .load import GasSpring as GasSpring, NonlinearSpring as NonlinearSpring, Orifice as Orifice, Soil as Soil
from .mesh_file import coarser as coarser, read_mesh as read_mesh
from .motor import Motor as Motor
from .parameter import Parameters as Parameters, declared_with as declared_with, with_si_symbols as with_si_symbols
from .pose import Frame as Frame, Particle as Particle, Planar as Planar, Spatial as Spatial
from .random_input import LEVELS as LEVELS, RandomInput as RandomInput
from .rope import Rope as Rope
from .rotation import Rotation as Rotation, rotation as rotation
from .shape_contact import (
    BoxContact as BoxContact,
    CircleContact as CircleContact,
    SlotContact as SlotContact,
    SphereContact as SphereContact,
)
from .state import Input as Input, OwnState as OwnState, Sampled as Sampled, State as State, States as States
