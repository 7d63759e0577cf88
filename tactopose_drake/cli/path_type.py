"""The click type of arguments and options that are paths."""

from pathlib import Path
from typing import Any

import click


class _Path(click.Path):
    """A path; an empty one, as of a shell's variable that is not set, would be the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; fails if it is empty."""
        if value == "":
            self.fail("It must be a path, not empty.", param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path(path_type=Path)
