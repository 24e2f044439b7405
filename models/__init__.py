"""Scenes as functions `scene(...) -> Scene`, each with a sketch and its source."""
