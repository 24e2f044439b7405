"""What is rounding, the same, slight or small is decided here. Names elsewhere say what is compared with it.

All but `LARGEST` and `MEETING` are shares: of 1, of the largest of some terms, or of the size of a scene. A double has
16 digits.
"""

LAST_DIGITS = 1e-15
"""Errors of a few operations, as of cosines: several units in the last place of 1."""
FACTORS = 1e-14
"""Pivots and singular values that are rounding: factors of a small matrix lose one digit or two."""
ROUNDING = 1e-12
"""Sums of many terms keep 12 digits: what is smaller is their rounding."""
SAME = 1e-9
"""Numbers that texts and files hold, and that Newton's method leaves, agree to 9 digits, or are different ones."""
SLIGHT = 1e-6
"""Ill-conditioned equations keep 6 digits, and no drawing asks for more: what is smaller has no effect."""
SMALL = 1e-3
"""A part that changes the third digit of a result: what is smaller is measured beside something else."""
NOTHING = 1e-300
"""A number that keeps a denominator from 0, and changes no sum."""
LARGEST = 1e30
"""Largest length, mass or moment of inertia [SI]: products of several of these are numbers, too."""
MEETING = 1e-12
"""Length [m] or angle [rad] below which nothing is apart: no direction leads from one point to the other, and third
derivatives of forces exceed double precision."""
