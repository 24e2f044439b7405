"""The names that other rooms use. `_doors` loads their modules when they are used."""

from . import dop853 as dop853, rosenbrock as rosenbrock
from .embedded_pair import MOST_STEPS as MOST_STEPS, ROUNDED_STEP as ROUNDED_STEP, STEP_CONTROL as STEP_CONTROL
from .generalized_alpha import generalized_alpha as generalized_alpha
from .nstiff_si2 import nstiff_si2 as nstiff_si2
from .roots import roots as roots
from .runge_kutta import CLASSICAL as CLASSICAL, Tableau as Tableau
from .step import Step as Step
