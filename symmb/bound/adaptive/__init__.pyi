"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .adaptive_bounds import MOST_RUNS as MOST_RUNS, adaptive_bounds as adaptive_bounds
from .continuation import extrapolated_sizes as extrapolated_sizes, largest as largest
from .monotone import Corners as Corners
from .oscillations import Waveforms as Waveforms
from .outputs import PerOutput as PerOutput
from .response_surface import ResponseSurface as ResponseSurface
from .secants import excess_beside_extremes as excess_beside_extremes
from .small_study import Studies as Studies
from .sparse_grid import NearExtremes as NearExtremes, SparseGrid as SparseGrid
from .studies import studies as studies
from .tensor_grids import TensorGrids as TensorGrids
