"""Results in files: written completely or not at all, and checked when they are read."""

from symmb._doors import open_door

open_door(__name__)
