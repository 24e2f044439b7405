"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .casadi_solvers import CVODES as CVODES, IDAS as IDAS, StabilizedIndex2 as StabilizedIndex2
from .cells import refined as refined
from .compiled import CompiledSolver as CompiledSolver, Task as Task, impacts_text as impacts_text
from .contacts import (
    contact_functions as contact_functions,
    contacts_of as contacts_of,
    started as started,
    with_gaps as with_gaps,
)
from .event_driven import EventDriven as EventDriven, round_otherwise as round_otherwise
from .explicit import DormandPrince as DormandPrince

from .fixed_step import (
    collocation as collocation,
    explicit_steps as explicit_steps,
    fixed_step_integration as fixed_step_integration,
    implicit_steps as implicit_steps,
)
from .implicit import Rosenbrock as Rosenbrock
from .integration import Integration as Integration, Run as Run
from .one_sided import OneSided as OneSided, one_sided as one_sided
from .position_schemes import NSTIFFSI2 as NSTIFFSI2, GeneralizedAlpha as GeneralizedAlpha
from .projection import project as project
from .registry import SOLVERS as SOLVERS, WORDS as WORDS, read_solver as read_solver
from .rosenbrock_step import rosenbrock as rosenbrock
from .solver import Solver as Solver, solver_of as solver_of
from .stabilization import AugmentedLagrangian as AugmentedLagrangian
from .stabilized_index2 import stabilized_problem as stabilized_problem
from .stiffness import STIFF as STIFF, Stiffness as Stiffness, some_states as some_states, stiffness as stiffness
from .switch_passes import SwitchPasses as SwitchPasses, follow_doubts as follow_doubts
