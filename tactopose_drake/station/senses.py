"""Senses of a scenario that need no device: the simulator's, and those of a recording; only data."""

import dataclasses

from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(kw_only=True, slots=True)
class SimulatedSenses:
    """The simulator's own sensors, `!SimulatedSenses` in YAML."""


@dataclasses.dataclass(kw_only=True, slots=True)
class RecordedSenses:
    """A recording by `tactopose run --record`, `!RecordedSenses` in YAML."""

    folder: str = ""  # folder of the recording

    def validate(self) -> None:
        """Raises InvalidInputError if no folder is named."""
        if not self.folder:
            raise InvalidInputError("RecordedSenses.folder must be one that `run --record` made, not empty.")
