"""Running scenarios: in the simulator, on CAN devices, and from recordings."""
