"""The only list of the public names, by subject. `__init__.py` reads this list to load and to list the names."""

__version__: str
__citation__: str

# Models
from .declare.mechanics.parameter import Parameters as Parameters
from .equations.model.box import Box as Box
from .equations.model.system import System as System
from .equations.model.scene import Scene as Scene
from .declare.mechanics.state import State as State, States as States
from .declare.mechanics.state import Input as Input
from .declare.mechanics.random_input import RandomInput as RandomInput, RoadProfile as RoadProfile
from .declare.symbolic.symbols import t as t, ddt as ddt, initial as initial
from .declare.mechanics.robots.urdf_file import load_urdf as load_urdf
from .declare.mechanics.robots.mjcf_file import load_mjcf as load_mjcf
from .equations.model.compilation import compile_dae as compile_dae

# Bodies
from .declare.mechanics.body import Body as Body, Ground as Ground
from .declare.mechanics.pose import Planar as Planar, Spatial as Spatial, Particle as Particle
from .declare.mechanics.rotation import rotation as rotation
from .declare.mechanics.flexible_body import FlexibleBody as FlexibleBody
from .declare.structures.beams import Beam as Beam
from .declare.structures.finite_elements import FiniteElements as FiniteElements
from .declare.structures.modes import Modes as Modes
from .declare.structures.section import Material as Material, Section as Section

# Shapes of bodies in drawings
from .declare.mechanics.geometry import Box3 as Box3, Cylinder as Cylinder, Sphere as Sphere, Mesh as Mesh

# Joints, motors, stops
from .declare.mechanics.joint import Revolute as Revolute, Prismatic as Prismatic, Cylindrical as Cylindrical
from .declare.mechanics.joint import (
    Spherical as Spherical,
    Universal as Universal,
    PlanarJoint as PlanarJoint,
    Screw as Screw,
)
from .declare.mechanics.joint import Weld as Weld, Distance as Distance, PointOnLine as PointOnLine, Gear as Gear
from .declare.mechanics.curve_contact import PointOnCurve as PointOnCurve
from .declare.mechanics.joint import CamFollower as CamFollower
from .declare.mechanics.constraint import Motion as Motion, VelocityConstraint as VelocityConstraint
from .declare.mechanics.actuator import Actuator as Actuator
from .declare.mechanics.motor import Motor as Motor
from .declare.mechanics.clutch import Clutch as Clutch
from .declare.mechanics.actuator import Stop as Stop
from .declare.mechanics.joint_event import Release as Release, Latch as Latch

# Forces
from .declare.mechanics.force import (
    Gravity as Gravity,
    Spring as Spring,
    Damper as Damper,
    SpringDamper as SpringDamper,
)
from .declare.mechanics.force import TorsionSpring as TorsionSpring, Bushing as Bushing
from .declare.mechanics.load import NonlinearSpring as NonlinearSpring, GasSpring as GasSpring
from .declare.mechanics.rope import Rope as Rope
from .declare.mechanics.force import Force as Force, Torque as Torque
from .declare.mechanics.load import Orifice as Orifice, Soil as Soil
from .declare.mechanics.table import Table as Table
from .declare.mechanics.state import Sampled as Sampled

# Contact, friction, impacts
from .declare.mechanics.contact import BushContact as BushContact, Contact as Contact
from .declare.mechanics.shape_contact import CircleContact as CircleContact, SlotContact as SlotContact
from .declare.mechanics.shape_contact import SphereContact as SphereContact, BoxContact as BoxContact
from .declare.mechanics.curve import Curve as Curve
from .declare.mechanics.curve_contact import CurveContact as CurveContact
from .declare.mechanics.contact import ToothContact as ToothContact, TorsionContact as TorsionContact
from .declare.mechanics.contact_law import Flores as Flores, HuntCrossley as HuntCrossley, KelvinVoigt as KelvinVoigt
from .declare.mechanics.contact_law import LankaraniNikravesh as LankaraniNikravesh, Tabulated as Tabulated
from .declare.mechanics.friction import Bristle as Bristle, Coulomb as Coulomb, Friction as Friction
from .declare.mechanics.impact import Impact as Impact

# Scalar outputs
from .declare.mechanics.figure import maximum as maximum, minimum as minimum, final as final, mean as mean
from .declare.mechanics.figure import first_time as first_time, value_at as value_at
from .declare.mechanics.figure import rms as rms, percentile as percentile, probability as probability, psd as psd

# Runs
from .run.simulation.single_run import simulate as simulate
from .run.simulation.subject import prepare as prepare
from .show.drawing.show import view as view
from .show.live.live import live as live
from .run.simulation.sweep import sweep as sweep, Sweep as Sweep
from .run.simulation.sensitivities import sensitivities as sensitivities, Sensitivities as Sensitivities
from .run.simulation.derivatives import jax_function as jax_function, torch_function as torch_function
from .run.simulation.dae_simulator import DAESimulator as DAESimulator

# Solvers
from .run.integrate.casadi_solvers import CVODES as CVODES, IDAS as IDAS, Collocation as Collocation
from .run.integrate.casadi_solvers import StabilizedIndex2 as StabilizedIndex2
from .run.integrate.event_driven import EventDriven as EventDriven
from .run.integrate.explicit import DormandPrince as DormandPrince, RungeKutta as RungeKutta
from .run.integrate.position_schemes import (
    BDFI3 as BDFI3,
    HHT as HHT,
    NSTIFFSI2 as NSTIFFSI2,
    GeneralizedAlpha as GeneralizedAlpha,
)
from .run.integrate.position_schemes import Newmark as Newmark
from .run.integrate.implicit import Rosenbrock as Rosenbrock
from .run.integrate.stabilization import AugmentedLagrangian as AugmentedLagrangian, Baumgarte as Baumgarte
from .run.integrate.stabilization import Projection as Projection
from .run.integrate.state_space import StateSpace as StateSpace

# Bounds and their methods
from .bound.propagation.propagation import propagate as propagate
from .bound.methods.method import Method as Method
from .bound.methods.polynomial_chaos import PolynomialChaos as PolynomialChaos
from .bound.methods.taylor import Taylor as Taylor
from .bound.methods.taylor_model import TaylorModel as TaylorModel
from .bound.methods.sampling import MonteCarlo as MonteCarlo, Scanning as Scanning, Vertex as Vertex
from .bound.methods.optimization import Optimization as Optimization
from .bound.methods.swarm import Swarm as Swarm
from .bound.methods.interval_arithmetic import IntervalArithmetic as IntervalArithmetic

# Nodes and polynomials
from .bound.nodes.quadrature import ChebyshevGauss as ChebyshevGauss, ClenshawCurtis as ClenshawCurtis, Gauss as Gauss
from .bound.nodes.quadrature import Leja as Leja, SparseGrid as SparseGrid
from .bound.nodes.samplers import LatinHypercube as LatinHypercube, Random as Random, Sobol as Sobol
from .bound.polynomials.basis import HyperbolicCross as HyperbolicCross, TensorDegree as TensorDegree
from .bound.polynomials.basis import TotalDegree as TotalDegree
from .bound.polynomials.ranges.exact import Exact as Exact
from .bound.polynomials.ranges.inclusion import Bernstein as Bernstein
from .bound.polynomials.ranges.inclusion import ChebyshevInclusion as ChebyshevInclusion
from .bound.polynomials.ranges.inclusion import LegendreInclusion as LegendreInclusion

# Answers
from .study.compare import compare as compare
from .study.tolerances import tolerances as tolerances, Tolerances as Tolerances
from .study.design import design as design, Design as Design
from .study.calibration import calibrate as calibrate, Calibration as Calibration
from .study.consistent import ConsistentSet as ConsistentSet
from .study.stability import stability as stability, Stability as Stability
from .study.root_locus import root_locus as root_locus, RootLocus as RootLocus

# Linearisation
from .run.linear.critical import critical as critical
from .run.linear.linearization import linearize as linearize
from .run.linear.modal_simulator import ModalSimulator as ModalSimulator

# Black boxes
from .connect.command_simulator import CommandSimulator as CommandSimulator
from .connect.fmu_simulator import FMUSimulator as FMUSimulator
from .connect.function_simulator import FunctionSimulator as FunctionSimulator
from .connect.recorded_runs import RecordedRuns as RecordedRuns
from .connect.stored_simulator import StoredSimulator as StoredSimulator

# Scenes for other programs
from .show.exchange.fmu import save_fmu as save_fmu

# Results
from .run.simulation.trajectory import Trajectory as Trajectory
from .run.events.impulses import Event as Event
from .bound.answers.result import Bounds as Bounds
from .bound.answers.contributions import Contributions as Contributions
from .bound.answers.limits import LimitCheck as LimitCheck
from .bound.polynomials.expansion import Expansion as Expansion, Moments as Moments
from .study.comparison_result import Comparison as Comparison
from .run.linear.result import Linearization as Linearization

# Errors
from ._errors import AssemblyError as AssemblyError, DeclarationError as DeclarationError
from ._errors import PropagationError as PropagationError, SimulationError as SimulationError, SymmbError as SymmbError
from ._errors import SymmbWarning as SymmbWarning
