"""A camera in place of touch: depth images, what the hand hides, and a tracker on them."""
