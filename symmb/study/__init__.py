"""Studies of a scene: comparison of bounding methods, and stability of solvers.

Both report errors against run time.
"""

from symmb.study.compare import compare
from symmb.study.comparison_result import Comparison
from symmb.study.stability import Stability, stability
