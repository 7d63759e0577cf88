"""The mathematics: functions and frozen dataclasses over arrays; no pydrake, no clock, no global random state."""
