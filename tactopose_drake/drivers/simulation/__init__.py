"""Simulated devices, which speak the real ones' protocols on the other end of a bus, and fail on command."""
