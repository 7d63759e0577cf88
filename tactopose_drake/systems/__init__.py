"""LeafSystems, one a file, each with a thin body around one call into core."""
