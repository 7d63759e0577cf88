"""What arguments and options that are paths are for click."""

from pathlib import Path

import click

PATH = click.Path(path_type=Path)
