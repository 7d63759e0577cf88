"""Simulated grasps: from a plan to an object that stays in the hand, and the true contacts then."""
