"""Checks of runs by a second run, by drifts of constraints and energy, and by the linear theory of flexible bodies."""

from symmb.run.verification.examination import Drift, Energy, Examination, drift, energy, work_of
from symmb.run.verification.linear_theory import deformation_doubts, linear_theory_doubts
from symmb.run.verification.missing_modes import AttachedLoads, attached_loads, with_loads
from symmb.run.verification.two_ways import OtherWays, TwoWays, in_two_ways, other_way
