"""The lock of all calls of CasADi."""

from threading import RLock

LOCK = RLock()
"""CasADi's reference counts are not atomic: one Python thread at a time calls CasADi. CasADi's own threads compute."""
