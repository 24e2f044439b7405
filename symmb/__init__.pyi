"""The public names by subject: the only list of them. `__init__.py` reads it to load names and to list them."""

__version__: str
__citation__: str

# Models
from .mechanics.parameter import Parameters as Parameters
from .model.box import Box as Box
from .model.system import System as System
from .model.scene import Scene as Scene
from .mechanics.state import State as State
from .mechanics.input import Input as Input
from .symbolic.symbols import t as t, ddt as ddt, initial as initial
from .mechanics.robots.urdf_file import load_urdf as load_urdf
from .mechanics.robots.mjcf_file import load_mjcf as load_mjcf
from .model.compilation import compile_dae as compile_dae

# Bodies
from .mechanics.body import Body as Body, Ground as Ground
from .mechanics.pose import Planar as Planar, Spatial as Spatial, Particle as Particle
from .mechanics.rotation import rotation as rotation
from .mechanics.flexible_body import FlexibleBody as FlexibleBody
from .structures.beams import Beam as Beam
from .structures.finite_elements import FiniteElements as FiniteElements
from .structures.modes import Modes as Modes
from .structures.section import Material as Material, Section as Section

# Shapes of bodies in drawings
from .mechanics.geometry import Box3 as Box3, Cylinder as Cylinder, Sphere as Sphere, Mesh as Mesh

# Joints, motors, stops
from .mechanics.joint import Revolute as Revolute, Prismatic as Prismatic, Cylindrical as Cylindrical
from .mechanics.joint import Spherical as Spherical, Universal as Universal, PlanarJoint as PlanarJoint, Screw as Screw
from .mechanics.joint import Weld as Weld, Distance as Distance, PointOnLine as PointOnLine, Gear as Gear
from .mechanics.curve_contact import PointOnCurve as PointOnCurve
from .mechanics.joint import CamFollower as CamFollower
from .mechanics.constraint import Motion as Motion, VelocityConstraint as VelocityConstraint
from .mechanics.actuator import Actuator as Actuator
from .mechanics.motor import Motor as Motor
from .mechanics.clutch import Clutch as Clutch
from .mechanics.actuator import Stop as Stop
from .mechanics.joint_event import Release as Release, Latch as Latch

# Forces
from .mechanics.force import Gravity as Gravity, Spring as Spring, Damper as Damper, SpringDamper as SpringDamper
from .mechanics.force import TorsionSpring as TorsionSpring, Bushing as Bushing
from .mechanics.load import NonlinearSpring as NonlinearSpring, GasSpring as GasSpring
from .mechanics.rope import Rope as Rope
from .mechanics.force import Force as Force, Torque as Torque
from .mechanics.load import Orifice as Orifice, Soil as Soil
from .mechanics.table import Table as Table
from .mechanics.sampled import Sampled as Sampled

# Contact, friction, impacts
from .mechanics.contact import BushContact as BushContact, Contact as Contact
from .mechanics.shape_contact import CircleContact as CircleContact, SlotContact as SlotContact
from .mechanics.shape_contact import SphereContact as SphereContact, BoxContact as BoxContact
from .mechanics.curve import Curve as Curve
from .mechanics.curve_contact import CurveContact as CurveContact
from .mechanics.contact import ToothContact as ToothContact, TorsionContact as TorsionContact
from .mechanics.contact_law import Flores as Flores, HuntCrossley as HuntCrossley, KelvinVoigt as KelvinVoigt
from .mechanics.contact_law import LankaraniNikravesh as LankaraniNikravesh, Tabulated as Tabulated
from .mechanics.friction import Bristle as Bristle, Coulomb as Coulomb, Friction as Friction
from .mechanics.impact import Impact as Impact

# Scalar outputs
from .mechanics.figure import maximum as maximum, minimum as minimum, final as final, mean as mean
from .mechanics.figure import first_time as first_time, value_at as value_at

# Runs
from .simulation.single_run import simulate as simulate
from .simulation.subject import prepare as prepare
from .drawing.show import view as view
from .simulation.sweep import sweep as sweep, Sweep as Sweep
from .simulation.sensitivities import sensitivities as sensitivities, Sensitivities as Sensitivities
from .simulation.derivatives import jax_function as jax_function, torch_function as torch_function
from .simulation.dae_simulator import DAESimulator as DAESimulator

# Solvers
from .integrate.casadi_solvers import CVODES as CVODES, IDAS as IDAS, Collocation as Collocation
from .integrate.casadi_solvers import StabilizedIndex2 as StabilizedIndex2
from .integrate.event_driven import EventDriven as EventDriven
from .integrate.explicit import DormandPrince as DormandPrince, RungeKutta as RungeKutta
from .integrate.implicit import BDFI3 as BDFI3, HHT as HHT, NSTIFFSI2 as NSTIFFSI2, GeneralizedAlpha as GeneralizedAlpha
from .integrate.implicit import Newmark as Newmark, Rosenbrock as Rosenbrock
from .integrate.stabilization import AugmentedLagrangian as AugmentedLagrangian, Baumgarte as Baumgarte
from .integrate.stabilization import Projection as Projection
from .integrate.state_space import StateSpace as StateSpace

# Bounds and their methods
from .bounds.propagation import propagate as propagate
from .bounds.polynomial_chaos import PolynomialChaos as PolynomialChaos
from .bounds.taylor import Taylor as Taylor
from .bounds.taylor_model import TaylorModel as TaylorModel
from .bounds.sampling import MonteCarlo as MonteCarlo, Scanning as Scanning, Vertex as Vertex
from .bounds.optimization import Optimization as Optimization
from .bounds.swarm import Swarm as Swarm
from .bounds.interval_arithmetic import IntervalArithmetic as IntervalArithmetic

# Nodes and polynomials
from .nodes.quadrature import ChebyshevGauss as ChebyshevGauss, ClenshawCurtis as ClenshawCurtis, Gauss as Gauss
from .nodes.quadrature import Leja as Leja, SparseGrid as SparseGrid
from .nodes.samplers import LatinHypercube as LatinHypercube, Random as Random, Sobol as Sobol
from .polynomials.basis import HyperbolicCross as HyperbolicCross, TensorDegree as TensorDegree
from .polynomials.basis import TotalDegree as TotalDegree
from .polynomials.ranges.bernstein import Bernstein as Bernstein
from .polynomials.ranges.exact import Exact as Exact
from .polynomials.ranges.inclusion import ChebyshevInclusion as ChebyshevInclusion
from .polynomials.ranges.inclusion import LegendreInclusion as LegendreInclusion

# Answers
from .study.compare import compare as compare
from .study.tolerances import tolerances as tolerances, Tolerances as Tolerances
from .study.calibration import calibrate as calibrate, Calibration as Calibration
from .study.stability import stability as stability, Stability as Stability
from .study.root_locus import root_locus as root_locus, RootLocus as RootLocus

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
from .polynomials.expansion import Expansion as Expansion, Moments as Moments
from .study.comparison_result import Comparison as Comparison
from .linear.result import Linearization as Linearization

# Errors
from ._errors import AssemblyError as AssemblyError, DeclarationError as DeclarationError
from ._errors import PropagationError as PropagationError, SimulationError as SimulationError, SymmbError as SymmbError
from ._errors import SymmbWarning as SymmbWarning
