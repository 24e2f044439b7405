"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .comparison_result import Comparison as Comparison
from .tolerances import tolerances as tolerances
