"""Damaged files of some seeds, in short; and that the fuzzer sees what it is to see."""

import functools
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tests.fuzz import file_damage, files, recordings


@pytest.mark.parametrize("kind", [files.yaml_files, recordings.recordings])
@pytest.mark.parametrize("seed", range(5))
def test_damaged_files_are_read_or_refused(kind: Callable[[np.random.Generator], None], seed: int) -> None:
    for call in range(20):
        kind(np.random.default_rng([seed, call]))


def test_what_is_not_damaged_is_read() -> None:
    for name, text, load in files._schemas():
        if name != "own.hand.yaml" or "package://tactopose_drake" in text:
            with files.own_folder() as folder:
                (folder / name).write_text(text)
                load(folder / name)


@pytest.mark.parametrize("has_boards", [False, True])
def test_a_recording_that_is_not_damaged_is_played(has_boards: bool) -> None:
    base = recordings._recordings()[has_boards]
    with files.own_folder() as folder:
        for name, content in base.items():
            (folder / name).write_bytes(content)
        recordings._play(folder, recordings._scenario(has_boards), is_whole=False)
        (folder / "manifest.yaml").write_text("format: 1")
        with pytest.raises(InvalidInputError):
            recordings._play(folder, recordings._scenario(has_boards), is_whole=False)


def test_a_damage_changes_the_text() -> None:
    changed = [
        file_damage.damage(files.CONTACTS, np.random.default_rng(seed)) != files.CONTACTS.encode()
        for seed in range(200)
    ]
    assert sum(changed) > 180


def _write_elsewhere(path: Path) -> None:
    path.write_text("stray")


@pytest.mark.parametrize(
    ("read", "place"),
    [
        (_write_elsewhere, "file"),
        (lambda path: os.system("true"), "elsewhere/file"),
        (lambda path: path.parent.mkdir(), "elsewhere/file"),
    ],
)
def test_a_file_that_does_something_is_a_finding(tmp_path: Path, read: Callable[[Path], object], place: str) -> None:
    def call() -> None:
        with files.own_folder():
            read(tmp_path / place)

    with pytest.raises(AssertionError, match="a file made the reader do this"):
        call()


@pytest.mark.parametrize("message", ["", "two\nlines", "x" * 10_000])
def test_a_refusal_that_is_no_line_is_a_finding(message: str) -> None:
    def refuse() -> None:
        raise InvalidFileError(message)

    with pytest.raises(AssertionError, match="a refusal"):
        files.read(refuse)


def test_a_traceback_is_a_finding() -> None:
    with pytest.raises(ZeroDivisionError):
        files.read(functools.partial(divmod, 1, 0))


def test_references_to_references_are_refused_before_they_are_followed(tmp_path: Path) -> None:
    for seed in range(20):
        (tmp_path / "contacts.yaml").write_text(file_damage._laugh(files.CONTACTS, np.random.default_rng(seed)))
        with pytest.raises(InvalidFileError):
            files.load_contacts(tmp_path / "contacts.yaml")
