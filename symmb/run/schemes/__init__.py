"""Time steps as data: tableaus and symbolic residuals, one file for each method.

The loops that take these steps are in `codegen` and `integrate`.
"""

from symmb.run.schemes import dop853, rosenbrock
from symmb.run.schemes.embedded_pair import MOST_STEPS, ROUNDED_STEP, STEP_CONTROL
from symmb.run.schemes.generalized_alpha import generalized_alpha
from symmb.run.schemes.nstiff_si2 import nstiff_si2
from symmb.run.schemes.roots import roots
from symmb.run.schemes.runge_kutta import CLASSICAL, Tableau
from symmb.run.schemes.step import Step
