"""What arguments and options that are hands are for click."""

from typing import Any

import click

_SHORT = {"shadow": "shadow_like", "barrett": "barrett_like"}


class _HandName(click.ParamType[str]):
    """A hand of the package by name, which may be short, or a hand's YAML file by path."""

    name = "hand"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name or path as `load_hand_config` takes it."""
        return _SHORT.get(value, str(value))


HAND = _HandName()
HAND_HELP = "A hand of the package by name, such as shadow or barrett, or a hand's YAML file by its path"
