"""Bounds by one surrogate: a tree of boxes, in each of which a hierarchical interpolant grows where it varies."""

from symmb.bounds.refinement.refined_bounds import refined_bounds, refined_range
