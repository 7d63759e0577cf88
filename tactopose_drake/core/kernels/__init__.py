"""Inner loops of objectives, searches, posteriors, shapes, sensing and tracking: compiled by numba, cached on disk."""
