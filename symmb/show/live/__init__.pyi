"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .live import live as live, live_from as live_from
from .surrogate import live_surrogate as live_surrogate
