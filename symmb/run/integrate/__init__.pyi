"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .casadi_solvers import CVODES as CVODES, IDAS as IDAS, StabilizedIndex2 as StabilizedIndex2
from .cells import refined as refined
from .compiled import CompiledSolver as CompiledSolver, Task as Task, impacts_text as impacts_text
from .event_driven import EventDriven as EventDriven, round_otherwise as round_otherwise
from .explicit import DormandPrince as DormandPrince
from .implicit import Rosenbrock as Rosenbrock
from .position_schemes import NSTIFFSI2 as NSTIFFSI2, GeneralizedAlpha as GeneralizedAlpha
from .integration import Integration as Integration, Run as Run
from .projection import project as project
from .registry import SOLVERS as SOLVERS, WORDS as WORDS, read_solver as read_solver
from .solver import Solver as Solver, solver_of as solver_of
from .stabilization import AugmentedLagrangian as AugmentedLagrangian
from .stiffness import STIFF as STIFF, Stiffness as Stiffness, some_states as some_states, stiffness as stiffness
from .switch_passes import SwitchPasses as SwitchPasses, follow_doubts as follow_doubts
from .stabilized_index2 import stabilized_problem as stabilized_problem
from .fixed_step import collocation as collocation
from .fixed_step import fixed_step_integration as fixed_step_integration
from .contacts import contact_functions as contact_functions
from .contacts import contacts_of as contacts_of
from .contacts import started as started
from .contacts import with_gaps as with_gaps
from .fixed_step import explicit as explicit
from .fixed_step import implicit as implicit
from .rosenbrock_step import rosenbrock as rosenbrock
from .one_sided import one_sided as one_sided
from .one_sided import OneSided as OneSided
