"""Flexible bodies in numbers: finite elements, their reduction to modes, and the inertia of what deforms."""

from symmb.flexible.modes import Modes as Modes
