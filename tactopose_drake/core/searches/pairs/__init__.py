"""Poses from pairs of contacts: matches among the pairs of surface samples, and their cost on the coarse field."""
