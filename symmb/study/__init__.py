"""Studies of a scene as a whole: which method bounds it best, and at what cost."""

from symmb.study.compare import compare_simulator as compare_simulator
from symmb.study.compare import default_methods as default_methods
from symmb.study.comparison import Comparison as Comparison
from symmb.study.metrics import Score as Score
from symmb.study.reference import Reference as Reference
from symmb.study.row import NotRun as NotRun
from symmb.study.row import Row as Row
from symmb.study.stability import Stability as Stability
from symmb.study.stability import stability as stability
