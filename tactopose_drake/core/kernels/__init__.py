"""The inner loops of objectives and searches, compiled by numba and cached on disk."""
