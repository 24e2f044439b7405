"""Solvers of the index-reduced DAE and the drivers of their steps.

Each solver is a frozen object with its options in the constructor; `registry` lists them all.
"""

from symmb.integrate.casadi_solvers import CVODES, IDAS, Collocation, StabilizedIndex2
from symmb.integrate.compiled import AnyEngine, CompiledSolver
from symmb.integrate.event_driven import EventDriven, impacts_text
from symmb.integrate.explicit import DormandPrince, RungeKutta
from symmb.integrate.implicit import BDFI3, HHT, NSTIFFSI2, GeneralizedAlpha, Newmark, Rosenbrock
from symmb.integrate.integration import Integration, Run
from symmb.integrate.registry import SOLVERS, WORDS, SolverEntry, read_solver
from symmb.integrate.solver import Solver
from symmb.integrate.stabilization import AugmentedLagrangian, Baumgarte, Projection
from symmb.integrate.state_space import StateSpace
from symmb.integrate.stiffness import STIFF, Stiffness, stiffness
