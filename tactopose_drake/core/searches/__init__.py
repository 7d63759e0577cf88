"""Searches: each minimises any objective and returns ranked poses."""
