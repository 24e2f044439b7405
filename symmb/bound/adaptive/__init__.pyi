"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .adaptive_bounds import MOST_RUNS as MOST_RUNS, adaptive_bounds as adaptive_bounds
from .small_study import Studies as Studies
from .studies import STUDIES as STUDIES
