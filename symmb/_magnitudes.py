"""Limits: which numbers count as rounding errors, as equal, as slight or as small.

All numbers except `LARGEST` and `MEETING` are relative: to 1, to the largest of some terms, or to the size of a scene.
The code that uses a limit says which numbers are compared. A double has 16 digits.
"""

LAST_DIGITS = 1e-15
"""Rounding errors of a few operations, such as cosines: several units in the last place of 1."""
FACTORS = 1e-14
"""Pivots and singular values below this value are rounding: factors of small matrices lose one or two digits."""
ROUNDING = 1e-12
"""Sums of many terms have 12 correct digits. Values below this value are rounding."""
SAME = 1e-9
"""Numbers in texts and files, and results of Newton's method, are equal if 9 digits agree."""
SLIGHT = 1e-6
"""Results of ill-conditioned equations have 6 correct digits. Smaller relative values have no effect."""
SMALL = 1e-3
"""A part of this size changes the third digit of a result. Errors of smaller parts are relative to the larger parts."""
NOTHING = 1e-300
"""A number that makes a denominator nonzero without changing a sum."""
LARGEST = 1e30
"""Largest length, mass or moment of inertia [SI]. Products of several such numbers must be finite."""
MEETING = 1e-12
"""Points closer than this length [m] or angle [rad] coincide. The direction between such points is undefined, and
third derivatives of forces between them exceed double precision."""
