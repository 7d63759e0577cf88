"""Senses of a scenario that need no device: of the simulator, and of a recording; only data."""

import dataclasses

from tactopose_drake.errors import InvalidInputError


@dataclasses.dataclass(kw_only=True, slots=True)
class SimulatedSenses:
    """The simulator's own sensors, `!SimulatedSenses` in YAML."""


@dataclasses.dataclass(kw_only=True, slots=True)
class RecordedSenses:
    """A recording that `tactopose run --record` has made, `!RecordedSenses` in YAML."""

    folder: str = ""  # that `run --record` made

    def validate(self) -> None:
        """Raises InvalidInputError if no folder is named."""
        if not self.folder:
            raise InvalidInputError("RecordedSenses.folder: is not given; allowed is one that `run --record` made.")
