"""Recordings of whole runs: one folder of CAN logs, signals, estimates, and a manifest."""
