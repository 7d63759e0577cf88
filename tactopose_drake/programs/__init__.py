"""MathematicalProgram formulations: the searches that Drake's solvers run."""
