"""What counts as rounding at the start."""

ROUNDING = 1e-9
"""Share of the terms of linear equations, or of the size of a scene, that is rounding of Newton's method; and singular
values of rows in their sizes, over the number of rows or columns, that count as zero. tests/start/test_start.py"""
NEGLIGIBLE = 1e-6
"""Share of the largest part from which on a part of a combination counts: roots of ill-conditioned equations."""
VIOLATION = 1e-7
"""Violation of rows at the start, over the largest coordinate or velocity and over 1, that is a contradiction."""
