"""Convex fingertip surfaces, S(p) = 0, with gradient and Hessian."""
