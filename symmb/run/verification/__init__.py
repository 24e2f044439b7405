"""Checks of runs by a second run, by drifts of constraints and energy, and by the linear theory of flexible bodies."""

from symmb._doors import open_door

open_door(__name__)
