"""The shape of objects: meshes as distance fields and samples, their symmetries, and their cache on disk."""
