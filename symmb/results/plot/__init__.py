"""Pictures of numbers, drawn with matplotlib from plain arrays.

The plot methods of results use these functions.
"""

from symmb._doors import open_door

open_door(__name__)
