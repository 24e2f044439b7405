"""Studies of a scene: comparison of bounding methods, and stability of solvers.

Both report errors against run time.
"""

from symmb.study.comparison_result import Comparison
