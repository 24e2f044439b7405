"""Solvers of the index-reduced DAE and the drivers of their steps.

Each solver is a frozen object with its options in the constructor.
"""

from symmb.integrate.event_driven import EventDriven, impacts_text
from symmb.integrate.explicit import AnyEngine, CompiledSolver, DormandPrince, RungeKutta
from symmb.integrate.implicit import BDFI3, HHT, NSTIFFSI2, GeneralizedAlpha, Newmark, Rosenbrock
from symmb.integrate.integration import Integration, Run
from symmb.integrate.solver import CVODES, IDAS, Collocation, Solver, StabilizedIndex2
from symmb.integrate.stabilization import AugmentedLagrangian, Baumgarte, Projection
from symmb.integrate.state_space import StateSpace
from symmb.integrate.stiffness import STIFF, Stiffness, stiffness
