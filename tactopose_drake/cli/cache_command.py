"""`tactopose cache`: what is kept of objects between runs."""

import time

import click

from tactopose_drake.cli.consoles import OUT
from tactopose_drake.core.shape import model_cache
from tactopose_drake.errors import InvalidInputError

_MB = 1e6


@click.command(name="cache")
@click.option("--clear", is_flag=True, help="Removes all of it; models are then built anew when they are needed.")
def cache_command(clear: bool) -> None:
    """Shows what is kept of objects between runs: models, their pairs of points, and libraries' indices.

    TACTOPOSE_CACHE_DIR names another folder, TACTOPOSE_CACHE_GB another limit.
    """
    folder, files = model_cache.cache_folder(), model_cache.cached_files()
    if folder.exists() and not folder.is_dir():
        raise InvalidInputError(f"{model_cache.FOLDER_VARIABLE}: is {folder}, which is no folder: nothing is kept.")
    if clear:
        size = model_cache.clear()
        OUT.print(f"Removed {len(files)} files, {size / _MB:.0f} MB, from {folder}", soft_wrap=True, highlight=False)
        return
    size, limit = sum(file.size for file in files), model_cache.cache_limit()
    OUT.print(f"{folder}", soft_wrap=True, highlight=False)
    OUT.print(
        f"{len(files)} files, {size / _MB:.0f} MB of {limit / _MB:.0f} MB, as {model_cache.LIMIT_VARIABLE} may say.",
        highlight=False,
    )
    if files:
        day = time.strftime("%Y-%m-%d %H:%M", time.localtime(files[0].used))
        OUT.print(f"The least recently used goes first; it was last used at {day}.", highlight=False)
