"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .critical import CriticalSimulator as CriticalSimulator, critical as critical, require_range as require_range
from .family import LinearFamily as LinearFamily
from .linearization import linearize as linearize
from .locus import QUANTITIES as QUANTITIES, LocusSimulator as LocusSimulator, nominal_locus as nominal_locus
from .modal_simulator import ModalSimulator as ModalSimulator
from .result import Linearization as Linearization, Mode as Mode
