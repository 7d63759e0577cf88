"""The click type of arguments and options that name a hand."""

from typing import Any

import click

_SHORT = {"shadow": "shadow_like", "barrett": "barrett_like"}


class _HandName(click.ParamType[str]):
    """A hand of the package by its name or short name, or a hand's YAML file by path."""

    name = "hand"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name or path for `load_hand_config`; fails if it is empty."""
        if value == "":
            self.fail("It must be a hand's name or path, not empty.", param, ctx)
        return _SHORT.get(value, str(value))


HAND = _HandName()
HAND_HELP = "A hand of the package by name, such as shadow or barrett, or a hand's YAML file by its path"
