"""Flexible bodies in numbers: finite elements, their reduction to modes, and the inertia of what deforms."""

from symmb.flexible.beams import Beam as Beam
from symmb.flexible.elements import FiniteElements as FiniteElements
from symmb.flexible.modes import Modes as Modes
from symmb.flexible.section import Material as Material
from symmb.flexible.section import Section as Section
