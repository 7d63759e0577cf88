"""Compiled loops that several folders share, and the objectives' loops over contacts, pads and forces."""
