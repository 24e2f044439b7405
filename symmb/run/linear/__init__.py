"""Linear equations of motion at a state, their eigenvalues and modes, and effects of parameters on eigenvalues.

`linearize` returns one linearisation. `ModalSimulator` computes frequencies for samples of the parameters.
"""

from symmb.run.linear.critical import CriticalSimulator, critical, require_range
from symmb.run.linear.family import LinearFamily
from symmb.run.linear.linearization import linearize
from symmb.run.linear.locus import QUANTITIES, LocusSimulator, nominal_locus
from symmb.run.linear.modal_simulator import ModalSimulator
from symmb.run.linear.result import Linearization, Mode
