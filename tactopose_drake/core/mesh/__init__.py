"""From a file to a closed, oriented triangle mesh, with every repair stated."""
