"""The searches that ours are compared with: the thesis' own, and published ones."""
