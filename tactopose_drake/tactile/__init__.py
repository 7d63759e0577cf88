"""Tactile arrays beyond the core: their files, their calibration, and what they feel in the simulator."""
