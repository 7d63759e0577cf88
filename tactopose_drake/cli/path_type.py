"""The click type of arguments and options that are paths."""

from pathlib import Path

import click

PATH = click.Path(path_type=Path)
