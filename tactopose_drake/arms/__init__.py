"""An arm that carries the hand: its models, motions, station, and what it places."""
