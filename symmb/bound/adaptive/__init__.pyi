"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .adaptive_bounds import MOST_RUNS as MOST_RUNS, adaptive_bounds as adaptive_bounds
from .small_study import Studies as Studies
from .studies import studies as studies
from .secants import excess_beside_extremes as excess_beside_extremes
from .sparse_grid import SparseGrid as SparseGrid
from .monotone import Corners as Corners
from .response_surface import ResponseSurface as ResponseSurface
from .sparse_grid import NearExtremes as NearExtremes
from .oscillations import Waveforms as Waveforms
from .tensor_grids import TensorGrids as TensorGrids
from .outputs import PerOutput as PerOutput
from .continuation import extrapolated_sizes as extrapolated_sizes
from .continuation import largest as largest
