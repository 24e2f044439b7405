"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .bounds_report import write_bounds as write_bounds
from .comparison_report import write_comparison as write_comparison
from .document import BLOCK as BLOCK
