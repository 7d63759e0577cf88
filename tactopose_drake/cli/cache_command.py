"""`tactopose cache`: shows and clears the cache of objects' models."""

import contextlib
import os
import time
from pathlib import Path

import click

from tactopose_drake.cli.consoles import OUT
from tactopose_drake.core.shape import model_cache
from tactopose_drake.errors import InvalidInputError

_MB = 1e6


@click.command(name="cache")
@click.option("--clear", is_flag=True, help="Empties the cache; models are then rebuilt when they are needed.")
def cache_command(clear: bool) -> None:
    """Shows the cache of objects: models, their pairs of points, and libraries' indices.

    Set another folder by TACTOPOSE_CACHE_DIR, and another limit by TACTOPOSE_CACHE_GB.
    """
    folder, files = _folder(), model_cache.cached_files()
    if clear:
        size = model_cache.clear()
        OUT.print(f"Removed {len(files)} files, {size / _MB:.0f} MB, from {folder}", soft_wrap=True, highlight=False)
        return
    size, limit = sum(file.size for file in files), model_cache.cache_limit()
    OUT.print(f"{folder}", soft_wrap=True, highlight=False)
    OUT.print(
        f"{len(files)} files, {size / _MB:.0f} MB of {limit / _MB:.0f} MB ({model_cache.LIMIT_VARIABLE} sets it).",
        highlight=False,
    )
    if files:
        day = time.strftime("%Y-%m-%d %H:%M", time.localtime(files[0].used))
        OUT.print(f"The least recently used file is dropped first; it was last used at {day}.", highlight=False)


def _folder() -> Path:
    """The cache's folder, which need not exist.

    Raises:
        InvalidInputError: if it is no folder or cannot be read.
    """
    name = model_cache.FOLDER_VARIABLE
    try:
        folder = model_cache.cache_folder()
    except RuntimeError:
        raise InvalidInputError(
            f"{name} must be a folder, not {os.environ[name]}, whose user has no home: nothing is cached."
        ) from None
    try:
        with contextlib.suppress(FileNotFoundError):
            os.scandir(folder).close()
    except NotADirectoryError:
        raise InvalidInputError(f"{name} must be a folder, not {folder}, which is none: nothing is cached.") from None
    except OSError as error:
        raise InvalidInputError(f"{name} must be a folder that can be read, not {folder} ({error.strerror}).") from None
    return folder
