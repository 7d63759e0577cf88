"""Simulated devices with the real ones' protocols, at the other end of a bus, and faults for tests."""
