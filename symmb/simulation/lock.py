"""The lock of all calls of CasADi."""

from threading import RLock

LOCK = RLock()
"""CasADi's reference counts are not atomic: Python threads take turns. CasADi's own threads do the work."""
