"""Bounds of responses over boxes of parameters: methods, and what they return."""

from symmb._box import Box as Box
from symmb.bounds._basis import Basis as Basis
from symmb.bounds._basis import TensorDegree as TensorDegree
from symmb.bounds._basis import TotalDegree as TotalDegree
from symmb.bounds._chaos import PolynomialChaos as PolynomialChaos
from symmb.bounds._exact import Exact as Exact
from symmb.bounds._inclusion import LegendreInclusion as LegendreInclusion
from symmb.bounds._inclusion import Range as Range
from symmb.bounds._method import Method as Method
from symmb.bounds._natural import IntervalArithmetic as IntervalArithmetic
from symmb.bounds._nodes import ClenshawCurtis as ClenshawCurtis
from symmb.bounds._nodes import Gauss as Gauss
from symmb.bounds._nodes import Nodes as Nodes
from symmb.bounds._nodes import SparseGrid as SparseGrid
from symmb.bounds._propagate import propagate as propagate
from symmb.bounds._result import Bounds as Bounds
from symmb.bounds._result import Failure as Failure
from symmb.bounds._samplers import LatinHypercube as LatinHypercube
from symmb.bounds._samplers import Random as Random
from symmb.bounds._samplers import Sampler as Sampler
from symmb.bounds._samplers import Sobol as Sobol
from symmb.bounds._sampling import MonteCarlo as MonteCarlo
from symmb.bounds._sampling import Scanning as Scanning
from symmb.bounds._sampling import Vertex as Vertex
from symmb.bounds._taylor import Taylor as Taylor
