"""An arm that carries the hand: its motions, and what it takes and places."""
