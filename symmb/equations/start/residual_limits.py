"""Largest residuals and violations that count as 0 at the start."""

from symmb._magnitudes import SAME

SOLVED = SAME
"""Singular values of scaled rows, divided by the number of rows or columns, are zero below this value. It is also the
residual of Newton's method relative to the terms of linear equations or to the size of a scene.
tests/start/test_start.py"""
VIOLATION = 1e-7
"""Accepted violation of rows at the start, relative to the largest coordinate or velocity, or to 1 if 1 is larger."""
