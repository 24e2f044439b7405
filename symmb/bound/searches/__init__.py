"""Searches for extremes in points of the unit box, and surrogates of few runs.

In:   a function of points of the unit box, or runs.
Out:  its smallest value and the place; a surrogate, a Gaussian process or a quadratic model.
"""

from symmb._doors import open_door

open_door(__name__)
