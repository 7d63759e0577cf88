"""What fingertips feel: force and torque at a known surface, and pressure on arrays of cells."""
