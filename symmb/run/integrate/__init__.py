"""Solvers of the index-reduced DAE and the drivers of their steps.

Each solver is a frozen object with options. `registry` lists all solvers. Compiled solvers take their steps in the C
code of `codegen`.
"""

from symmb.run.integrate.casadi_solvers import CVODES, IDAS, StabilizedIndex2
from symmb.run.integrate.cells import refined
from symmb.run.integrate.compiled import CompiledSolver, Task, impacts_text
from symmb.run.integrate.event_driven import EventDriven, round_otherwise
from symmb.run.integrate.explicit import DormandPrince
from symmb.run.integrate.implicit import NSTIFFSI2, GeneralizedAlpha, Rosenbrock
from symmb.run.integrate.integration import Integration, Run
from symmb.run.integrate.projection import project
from symmb.run.integrate.registry import SOLVERS, WORDS, read_solver, solver_of
from symmb.run.integrate.solver import Solver
from symmb.run.integrate.stabilization import AugmentedLagrangian
from symmb.run.integrate.stiffness import STIFF, Stiffness, some_states, stiffness
from symmb.run.integrate.switch_passes import SwitchPasses, follow_doubts
