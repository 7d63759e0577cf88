"""Sensors on CAN buses, with python-can: drivers, simulated devices with the same protocols, recording, replay."""
