"""What a machine keeps for later: `tactopose cache`, `tactopose warm-up`, and how little a command loads."""

import errno
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.cli import warm_up_command
from tactopose_drake.core.shape import model_cache
from tactopose_drake.resources import model_path
from tests.cli.test_cli import run

KERNELS = {"tactopose_drake.core.kernels.sorting_kernels": ["copy_vector", "select"]}
LOADED = """
import sys
from tactopose_drake.cli import main
sys.argv = ["tactopose", *sys.argv[1:]]
try:
    main.main()
except SystemExit as stop:
    assert not stop.code, stop.code
print(*sys.modules)
"""
# Each of these takes as long to load as all that an estimate needs.
HEAVY = {"trimesh", "matplotlib", "networkx", "scipy.spatial", "scipy.special", "pydrake.geometry", "numba.np.linalg"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path / "models"))
    monkeypatch.setenv(model_cache.LIMIT_VARIABLE, "0.25")
    return tmp_path / "models"


def test_the_cache_is_shown_and_cleared(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("cache") == 0
    assert "0 files, 0 MB of 250 MB" in capsys.readouterr().out
    for key in ("a", "b"):
        model_cache.store(key, {"grid": np.zeros(250_000)})
    assert run("cache") == 0
    shown = capsys.readouterr().out
    assert str(folder) in shown
    assert "2 files, 4 MB of 250 MB" in shown
    assert "last used at 20" in shown
    assert run("cache", "--clear") == 0
    assert "Removed 2 files, 4 MB" in capsys.readouterr().out
    assert list(folder.iterdir()) == []


def test_a_limit_that_is_none_is_unusable_input(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(model_cache.LIMIT_VARIABLE, "plenty")
    assert run("cache") == 2
    assert "TACTOPOSE_CACHE_GB must be a number of gigabytes >= 0, not 'plenty'" in capsys.readouterr().err


def test_a_folder_of_the_cache_that_is_none_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path / "file"))
    assert run("cache") == 2
    assert "which is none: nothing is cached." in " ".join(capsys.readouterr().err.split())


def test_a_cache_that_cannot_be_cleared_is_unusable_input(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model_cache.store("a", {"grid": np.zeros(3)})

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "unlink", refuse)
    assert run("cache", "--clear") == 2
    told = capsys.readouterr().err
    assert "".join(told.split()) == f"error:{folder / 'a.npy'}cannotberemoved(Permissiondenied)."
    monkeypatch.setattr(os, "scandir", refuse)
    assert run("cache", "--clear") == 2
    told = capsys.readouterr().err
    assert "".join(told.split()).endswith(f"mustbeafolderthatcanberead,not{folder}(Permissiondenied).")


def test_a_folder_of_the_cache_in_no_home_is_unusable_input(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, "~nobody-of-this-name/models")
    assert run("cache") == 2
    assert "must be a folder, not ~nobody-of-this-name/models, whose" in " ".join(capsys.readouterr().err.split())


def test_what_is_not_compiled_is_compiled_elsewhere(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(warm_up_command, "missing_kernels", lambda: KERNELS)
    assert run("warm-up", "--jobs", "1") == 0
    assert "Compiled 2 kernels in" in capsys.readouterr().out
    monkeypatch.setattr(warm_up_command, "missing_kernels", dict)
    assert run("warm-up") == 0
    assert capsys.readouterr().out == "All kernels are compiled.\n"


def test_an_estimate_of_a_known_object_loads_little(tmp_path: Path, folder: Path) -> None:
    contacts = "contacts:\n" + "".join(
        f"- {{position: {p}, normal: {n}}}\n"
        for p, n in (
            ([0.03, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([0.0, 0.03, 0.01], [0.0, 1.0, 0.0]),
            ([0.0, 0.01, 0.03], [0.0, 0.0, 1.0]),
        )
    )
    (tmp_path / "contacts.yaml").write_text(contacts)
    command = [sys.executable, "-c", LOADED, "estimate", "--object", str(model_path("objects", "cube.obj"))]
    command += ["--contacts", str(tmp_path / "contacts.yaml")]
    for heavy in (True, False):  # built, and from the cache
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        loaded = set(done.stdout.splitlines()[-1].split())
        assert {"numba", "pydrake.math", "tactopose_drake.estimation.estimate"} <= loaded
        assert bool(loaded & HEAVY) == heavy, loaded & HEAVY


def test_a_run_without_a_picture_does_not_wait_for_matplotlib() -> None:
    code = (
        "import sys; from tactopose_drake.cli.main import cli; cli.get_command(None, 'run');"
        "cli.get_command(None, 'replay'); print('matplotlib' in sys.modules, 'pydrake' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


def test_help_names_all_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    shown = capsys.readouterr().out
    for name in ("cache", "demo", "estimate", "identify", "replay", "run", "warm-up"):
        assert f"\n  {name} " in shown
    assert run("no-such-command") == 2


def test_drake_says_nothing_but_warnings_once_a_command_is_loaded() -> None:
    """Loading Drake sets what its logger says; a command is loaded with it."""
    code = (
        "import logging; from tactopose_drake.cli.main import cli; cli.get_command(None, 'demo');"
        "import pydrake.geometry; print(logging.getLogger('drake').level)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(logging.WARNING)]
