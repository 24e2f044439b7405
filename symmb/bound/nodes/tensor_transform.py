"""One matrix for each parameter, applied to values on a tensor grid."""

import math
from collections.abc import Sequence

from symmb._types import Array


def transform_axes(matrices: Sequence[Array], Y: Array) -> Array:
    """(A_1 x ... x A_d) Y, the Kronecker product of d matrices (n_k, n_k) applied to Y (n_1 ... n_d, m).

    The cost is that of d small products instead of one with n_1 ... n_d rows and columns.
    """
    block, before = Y, 1
    for A in matrices:
        if len(A) > 1:
            block = A @ block.reshape(before, len(A), -1)
        before *= len(A)
    return block.reshape(before, math.prod(Y.shape) // before)
