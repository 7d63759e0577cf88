"""An arm that carries the hand: its motions, and the task of taking and placing a rod."""
