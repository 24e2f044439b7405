"""The public names by subject: the only list of them. `__init__.py` reads it to load names and to list them."""

__version__: str

# Models
from .mechanics.parameter import Parameters as Parameters
from .model.box import Box as Box
from .model.system import System as System
from .model.scene import Scene as Scene
from .mechanics.state import State as State
from .mechanics.input import Input as Input
from .symbolic.symbols import t as t
from .symbolic.symbols import ddt as ddt
from .symbolic.symbols import initial as initial
from .mechanics.robots.urdf_file import load_urdf as load_urdf
from .mechanics.robots.mjcf_file import load_mjcf as load_mjcf
from .model.compilation import compile_dae as compile_dae

# Bodies
from .mechanics.body import Body as Body
from .mechanics.body import Ground as Ground
from .mechanics.pose import Planar as Planar
from .mechanics.pose import Spatial as Spatial
from .mechanics.pose import Particle as Particle
from .mechanics.rotation import rotation as rotation
from .mechanics.flexible_body import FlexibleBody as FlexibleBody
from .structures.beams import Beam as Beam
from .structures.finite_elements import FiniteElements as FiniteElements
from .structures.modes import Modes as Modes
from .structures.section import Material as Material
from .structures.section import Section as Section

# Shapes of bodies in drawings
from .mechanics.geometry import Box3 as Box3
from .mechanics.geometry import Cylinder as Cylinder
from .mechanics.geometry import Sphere as Sphere
from .mechanics.geometry import Mesh as Mesh

# Joints, motors, stops
from .mechanics.joint import Revolute as Revolute
from .mechanics.joint import Prismatic as Prismatic
from .mechanics.joint import Cylindrical as Cylindrical
from .mechanics.joint import Spherical as Spherical
from .mechanics.joint import Universal as Universal
from .mechanics.joint import PlanarJoint as PlanarJoint
from .mechanics.joint import Screw as Screw
from .mechanics.joint import Weld as Weld
from .mechanics.joint import Distance as Distance
from .mechanics.joint import PointOnLine as PointOnLine
from .mechanics.joint import Gear as Gear
from .mechanics.curve_contact import PointOnCurve as PointOnCurve
from .mechanics.joint import CamFollower as CamFollower
from .mechanics.constraint import Motion as Motion
from .mechanics.constraint import VelocityConstraint as VelocityConstraint
from .mechanics.actuator import Actuator as Actuator
from .mechanics.motor import Motor as Motor
from .mechanics.clutch import Clutch as Clutch
from .mechanics.actuator import Stop as Stop
from .mechanics.joint_event import Release as Release
from .mechanics.joint_event import Latch as Latch

# Forces
from .mechanics.force import Gravity as Gravity
from .mechanics.force import Spring as Spring
from .mechanics.force import Damper as Damper
from .mechanics.force import SpringDamper as SpringDamper
from .mechanics.force import TorsionSpring as TorsionSpring
from .mechanics.force import Bushing as Bushing
from .mechanics.load import NonlinearSpring as NonlinearSpring
from .mechanics.load import GasSpring as GasSpring
from .mechanics.rope import Rope as Rope
from .mechanics.force import Force as Force
from .mechanics.force import Torque as Torque
from .mechanics.load import Orifice as Orifice
from .mechanics.load import Soil as Soil
from .mechanics.table import Table as Table
from .mechanics.sampled import Sampled as Sampled

# Contact, friction, impacts
from .mechanics.contact import BushContact as BushContact
from .mechanics.contact import Contact as Contact
from .mechanics.shape_contact import CircleContact as CircleContact
from .mechanics.shape_contact import SlotContact as SlotContact
from .mechanics.shape_contact import SphereContact as SphereContact
from .mechanics.shape_contact import BoxContact as BoxContact
from .mechanics.curve import Curve as Curve
from .mechanics.curve_contact import CurveContact as CurveContact
from .mechanics.contact import ToothContact as ToothContact
from .mechanics.contact import TorsionContact as TorsionContact
from .mechanics.contact_law import Flores as Flores
from .mechanics.contact_law import HuntCrossley as HuntCrossley
from .mechanics.contact_law import KelvinVoigt as KelvinVoigt
from .mechanics.contact_law import LankaraniNikravesh as LankaraniNikravesh
from .mechanics.contact_law import Tabulated as Tabulated
from .mechanics.friction import Bristle as Bristle
from .mechanics.friction import Coulomb as Coulomb
from .mechanics.friction import Friction as Friction
from .mechanics.impact import Impact as Impact

# Figures of a motion
from .mechanics.figure import maximum as maximum
from .mechanics.figure import minimum as minimum
from .mechanics.figure import final as final
from .mechanics.figure import mean as mean
from .mechanics.figure import first_time as first_time
from .mechanics.figure import value_at as value_at

# Runs
from .simulation.single_run import simulate as simulate
from .simulation.subject import prepare as prepare
from .drawing.show import view as view
from .simulation.sweep import sweep as sweep
from .simulation.sweep import Sweep as Sweep
from .simulation.sensitivities import sensitivities as sensitivities
from .simulation.sensitivities import Sensitivities as Sensitivities
from .simulation.derivatives import jax_function as jax_function
from .simulation.derivatives import torch_function as torch_function
from .simulation.dae_simulator import DAESimulator as DAESimulator

# Solvers
from .integrate.casadi_solvers import CVODES as CVODES
from .integrate.casadi_solvers import IDAS as IDAS
from .integrate.casadi_solvers import Collocation as Collocation
from .integrate.casadi_solvers import StabilizedIndex2 as StabilizedIndex2
from .integrate.event_driven import EventDriven as EventDriven
from .integrate.explicit import DormandPrince as DormandPrince
from .integrate.explicit import RungeKutta as RungeKutta
from .integrate.implicit import BDFI3 as BDFI3
from .integrate.implicit import HHT as HHT
from .integrate.implicit import NSTIFFSI2 as NSTIFFSI2
from .integrate.implicit import GeneralizedAlpha as GeneralizedAlpha
from .integrate.implicit import Newmark as Newmark
from .integrate.implicit import Rosenbrock as Rosenbrock
from .integrate.stabilization import AugmentedLagrangian as AugmentedLagrangian
from .integrate.stabilization import Baumgarte as Baumgarte
from .integrate.stabilization import Projection as Projection
from .integrate.state_space import StateSpace as StateSpace

# Bounds and their methods
from .bounds.propagation import propagate as propagate
from .bounds.polynomial_chaos import PolynomialChaos as PolynomialChaos
from .bounds.taylor import Taylor as Taylor
from .bounds.taylor_model import TaylorModel as TaylorModel
from .bounds.sampling import MonteCarlo as MonteCarlo
from .bounds.sampling import Scanning as Scanning
from .bounds.sampling import Vertex as Vertex
from .bounds.optimization import Optimization as Optimization
from .bounds.swarm import Swarm as Swarm
from .bounds.interval_arithmetic import IntervalArithmetic as IntervalArithmetic

# Nodes and polynomials
from .nodes.quadrature import ChebyshevGauss as ChebyshevGauss
from .nodes.quadrature import ClenshawCurtis as ClenshawCurtis
from .nodes.quadrature import Gauss as Gauss
from .nodes.quadrature import Leja as Leja
from .nodes.quadrature import SparseGrid as SparseGrid
from .nodes.samplers import LatinHypercube as LatinHypercube
from .nodes.samplers import Random as Random
from .nodes.samplers import Sobol as Sobol
from .polynomials.basis import HyperbolicCross as HyperbolicCross
from .polynomials.basis import TensorDegree as TensorDegree
from .polynomials.basis import TotalDegree as TotalDegree
from .polynomials.ranges.bernstein import Bernstein as Bernstein
from .polynomials.ranges.exact import Exact as Exact
from .polynomials.ranges.inclusion import ChebyshevInclusion as ChebyshevInclusion
from .polynomials.ranges.inclusion import LegendreInclusion as LegendreInclusion

# Answers
from .study.compare import compare as compare
from .study.tolerances import tolerances as tolerances
from .study.tolerances import Tolerances as Tolerances
from .study.calibration import calibrate as calibrate
from .study.calibration import Calibration as Calibration
from .study.stability import stability as stability
from .study.stability import Stability as Stability
from .study.root_locus import root_locus as root_locus
from .study.root_locus import RootLocus as RootLocus

# Linearisation
from .linear.critical import critical as critical
from .linear.linearization import linearize as linearize
from .linear.modal_simulator import ModalSimulator as ModalSimulator

# Black boxes
from .black_boxes.command_simulator import CommandSimulator as CommandSimulator
from .black_boxes.fmu_simulator import FMUSimulator as FMUSimulator
from .black_boxes.function_simulator import FunctionSimulator as FunctionSimulator
from .black_boxes.stored_simulator import StoredSimulator as StoredSimulator

# Scenes for other programs
from .exchange.fmu import save_fmu as save_fmu

# Results
from .simulation.trajectory import Trajectory as Trajectory
from .events.impulses import Event as Event
from .bounds.result import Bounds as Bounds
from .bounds.contributions import Contributions as Contributions
from .polynomials.expansion import Expansion as Expansion
from .polynomials.expansion import Moments as Moments
from .study.comparison_result import Comparison as Comparison
from .linear.result import Linearization as Linearization

# Errors
from ._errors import AssemblyError as AssemblyError
from ._errors import DeclarationError as DeclarationError
from ._errors import PropagationError as PropagationError
from ._errors import SimulationError as SimulationError
from ._errors import SymmbError as SymmbError
from ._errors import SymmbWarning as SymmbWarning
