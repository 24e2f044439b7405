"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .flexibility import Responses as Responses
from .inertia_invariants import Invariants as Invariants
from .modes import Modes as Modes
