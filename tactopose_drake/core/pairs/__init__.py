"""Pairs of contacts as point-pair features: where the object may be, and which of many objects it may be."""
