"""What is known at one instant of where the object is."""
