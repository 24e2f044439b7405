"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .casadi_solvers import CVODES as CVODES, IDAS as IDAS, StabilizedIndex2 as StabilizedIndex2
from .cells import refined as refined
from .compiled import CompiledSolver as CompiledSolver, Task as Task, impacts_text as impacts_text
from .event_driven import EventDriven as EventDriven, round_otherwise as round_otherwise
from .explicit import DormandPrince as DormandPrince
from .implicit import NSTIFFSI2 as NSTIFFSI2, GeneralizedAlpha as GeneralizedAlpha, Rosenbrock as Rosenbrock
from .integration import Integration as Integration, Run as Run
from .projection import project as project
from .registry import SOLVERS as SOLVERS, WORDS as WORDS, read_solver as read_solver, solver_of as solver_of
from .solver import Solver as Solver
from .stabilization import AugmentedLagrangian as AugmentedLagrangian
from .stiffness import STIFF as STIFF, Stiffness as Stiffness, some_states as some_states, stiffness as stiffness
from .switch_passes import SwitchPasses as SwitchPasses, follow_doubts as follow_doubts
