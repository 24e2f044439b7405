"""Linear equations of motion at a state: eigenvalues, modes, and how these depend on parameters.

`linearize` gives one linearisation, `ModalSimulator` frequencies for samples of the parameters.
"""

from symmb.linear.critical import CriticalSimulator, critical, require_range
from symmb.linear.family import LinearFamily
from symmb.linear.linearization import linearize
from symmb.linear.locus import QUANTITIES, LocusSimulator, nominal_locus
from symmb.linear.modal_simulator import ModalSimulator
from symmb.linear.result import Linearization, Mode
