"""Symbolic multibody dynamics with interval parameters.

Declare bodies, joints and forces; symmb derives the equations, compiles, simulates and bounds them. Write
`import symmb as mb`, and `help(mb.Body)` for one name. `symmb --help` tells where the guide is. The public names,
by subject:

Models
    Parameters, Box, System, Scene, State, Input, t, ddt, initial, load_urdf, load_mjcf, compile_dae
Bodies
    Body, Ground, Planar, Spatial, Particle, rotation, FlexibleBody, Beam, FiniteElements, Modes, Material, Section
Shapes of bodies in drawings
    Box3, Cylinder, Sphere, Mesh
Joints, motors, stops
    Revolute, Prismatic, Cylindrical, Spherical, Universal, PlanarJoint, Screw, Weld, Distance, PointOnLine, Gear,
    PointOnCurve, CamFollower, Motion, VelocityConstraint, Actuator, Motor, Clutch, Stop, Release,
    Latch
Forces
    Gravity, Spring, Damper, SpringDamper, TorsionSpring, Bushing, NonlinearSpring, GasSpring, Rope, Force, Torque,
    Orifice, Soil, Table, Sampled
Contact, friction, impacts
    BushContact, Contact, CircleContact, SlotContact, SphereContact, BoxContact, Curve, CurveContact, ToothContact,
    TorsionContact, Flores, HuntCrossley, KelvinVoigt, LankaraniNikravesh,
    Tabulated, Bristle, Coulomb, Friction, Impact
Figures of a motion
    maximum, minimum, final, mean, first_time, value_at
Runs
    simulate, prepare, view, sweep, Sweep, sensitivities, Sensitivities, jax_function, torch_function, DAESimulator
Solvers
    CVODES, IDAS, Collocation, StabilizedIndex2, EventDriven, DormandPrince, RungeKutta, BDFI3, HHT, NSTIFFSI2,
    GeneralizedAlpha, Newmark, Rosenbrock, AugmentedLagrangian, Baumgarte, Projection, StateSpace
Bounds and their methods
    propagate, PolynomialChaos, Taylor, TaylorModel, MonteCarlo, Scanning, Vertex, Optimization, Swarm,
    IntervalArithmetic
Nodes and polynomials
    ChebyshevGauss, ClenshawCurtis, Gauss, Leja, SparseGrid, LatinHypercube, Random, Sobol, HyperbolicCross,
    TensorDegree, TotalDegree, Bernstein, Exact, ChebyshevInclusion, LegendreInclusion
Answers
    compare, tolerances, Tolerances, calibrate, Calibration, stability, Stability, root_locus, RootLocus
Linearisation
    critical, linearize, ModalSimulator
Black boxes
    CommandSimulator, FMUSimulator, FunctionSimulator, StoredSimulator
Scenes for other programs
    save_fmu
Results
    Trajectory, Event, Bounds, Contributions, Expansion, Moments, Comparison, Linearization
Errors
    AssemblyError, DeclarationError, PropagationError, SimulationError, SymmbError, SymmbWarning
"""

# The public names stand in `__init__.pyi`; each room is loaded when one of its names is first used.

from typing import Any

import lazy_loader

from symmb._names import did_you_mean

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # it takes as long to load as all else here

        return version("symmb")
    try:
        return _public(name)
    except AttributeError:
        if name.startswith("_"):
            raise
        raise AttributeError(f"symmb has no name {name!r}.{did_you_mean(name, __all__)}", name=name) from None
