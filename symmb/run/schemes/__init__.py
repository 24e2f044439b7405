"""Time steps as data: tableaus and symbolic residuals, one file for each method.

The loops that take these steps are in `codegen` and `integrate`.
"""

from symmb._doors import open_door

open_door(__name__)
