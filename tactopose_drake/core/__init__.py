"""The mathematics: functions and frozen dataclasses over arrays, without pydrake, I/O, clocks or global random state."""
