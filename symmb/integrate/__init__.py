"""Solvers of the index-reduced DAE and the drivers of their steps.

Each solver is a frozen object with its options in the constructor; `registry` lists them all.
"""

from symmb.integrate.casadi_solvers import CVODES, IDAS, StabilizedIndex2
from symmb.integrate.cells import refined
from symmb.integrate.compiled import CompiledSolver, impacts_text
from symmb.integrate.event_driven import EventDriven, round_otherwise
from symmb.integrate.explicit import DormandPrince
from symmb.integrate.implicit import NSTIFFSI2, Rosenbrock
from symmb.integrate.integration import Integration, Run
from symmb.integrate.projection import project
from symmb.integrate.registry import SOLVERS, WORDS, read_solver, solver_of
from symmb.integrate.solver import Solver
from symmb.integrate.stabilization import AugmentedLagrangian
from symmb.integrate.stiffness import STIFF, Stiffness, stiffness
from symmb.integrate.switch_passes import SwitchPasses, follow_doubts
