"""What counts as rounding at the start."""

from symmb._magnitudes import SAME, SLIGHT

SOLVED = SAME
"""Share of the terms of linear equations, or of the size of a scene, that Newton's method leaves; and singular values
of rows in their sizes, over the number of rows or columns, that count as zero. tests/start/test_start.py"""
NEGLIGIBLE = SLIGHT
"""Share of the largest part from which on a part of a combination counts."""
VIOLATION = 1e-7
"""Violation of rows at the start, over the largest coordinate or velocity and over 1, that is a contradiction."""
