"""Faults of the cache of compiled kernels: folders that cannot be written or trusted, damaged files, full disks."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import tactopose_drake
from tactopose_drake.core.compilation import kernel
from tactopose_drake.core.kernel_cache import own_folder

CALL = """
import numpy as np
from tactopose_drake.core.kernels.pose_kernels import retract
out = np.empty((1, 3, 4))
retract(np.eye(3, 4)[None], np.zeros((1, 6)), out)
assert np.array_equal(out[0], np.eye(3, 4))
print(sum(retract.stats.cache_hits.values()))
"""


@pytest.fixture
def sealed(tmp_path: Path) -> dict[str, str]:
    """An environment in which neither the package's folder nor the home can be written, by no user."""
    source = Path(tactopose_drake.__file__).parent
    package = tmp_path / "sealed" / source.name
    shutil.copytree(source, package, copy_function=os.symlink, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (package, *(path for path in package.rglob("*") if path.is_dir())):
        (folder / "__pycache__").touch()  # a file, where a folder would have to be
    (tmp_path / "temporary").mkdir()
    gone = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "PYTHONPATH")
    return {name: value for name, value in os.environ.items() if name not in gone} | {
        "PYTHONPATH": str(package.parent),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HOME": os.devnull,
        "TMPDIR": str(tmp_path / "temporary"),
    }


def call(environment: dict[str, str]) -> tuple[int, str]:
    """How many kernels another process has found in the cache, and what it said."""
    command = [sys.executable, "-P", "-c", CALL]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return int(answer.stdout), answer.stderr


def test_where_nothing_can_be_written_kernels_are_kept_among_the_temporary_files(sealed: dict[str, str]) -> None:
    folder = Path(sealed["TMPDIR"], f"tactopose_drake-{os.getuid()}")
    for hits in (0, 1):
        found, said = call(sealed)
        assert found == hits
        assert said.count("\n") == 1
        assert f"compiled kernels are kept in {folder}, for their usual places cannot be written" in said
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_folder_that_others_may_write_is_not_believed(sealed: dict[str, str]) -> None:
    folder = Path(sealed["TMPDIR"], f"tactopose_drake-{os.getuid()}")
    folder.mkdir()
    folder.chmod(0o777)
    found, said = call(sealed)
    assert found == 0
    assert said.count("\n") == 1
    assert "there is no folder for compiled kernels, so each process compiles them anew" in said
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("obstacle", ["file", "link", "open"])
def test_the_folder_is_a_folder_of_this_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, obstacle: str
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder = own_folder()
    assert own_folder() == folder
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    if obstacle == "file":
        folder.touch(mode=0o600)
    elif obstacle == "link":
        folder.symlink_to(tmp_path / "elsewhere")
    else:
        folder.mkdir(mode=0o750)
    with pytest.raises(PermissionError, match="is not this user's alone"):
        own_folder()


def twice(number: float) -> float:
    return 2.0 * number


@pytest.fixture
def cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which `twice` is kept."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kernels"))
    assert kernel(twice)(2.0) == 4.0
    assert {path.suffix for path in files(tmp_path)} == {".nbi", ".nbc"}
    return tmp_path


def files(folder: Path) -> list[Path]:
    return sorted(path for path in (folder / "kernels").rglob("*") if path.is_file())


def hits(compiled: object) -> int:
    return sum(compiled.stats.cache_hits.values())  # type: ignore[attr-defined]


def test_what_is_whole_is_loaded(cached: Path) -> None:
    again = kernel(twice)
    assert again(3.0) == 6.0
    assert hits(again) == 1


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("content", [b"", b"\x80\x05", b"not a pickle"])
def test_what_is_damaged_is_compiled_anew_and_mended(cached: Path, suffix: str, content: bytes) -> None:
    (path,) = (path for path in files(cached) if path.suffix == suffix)
    path.write_bytes(content)
    for found in (0, 1):
        again = kernel(twice)
        assert again(3.0) == 6.0
        assert hits(again) == found


def test_a_full_disk_is_no_error(cached: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path in files(cached):
        path.unlink()
    compiled = kernel(twice)
    monkeypatch.setattr("os.replace", fail)
    assert compiled(2.0) == 4.0
    assert not [path for path in files(cached) if path.suffix == ".nbc"]


def fail(*_: object) -> None:
    raise OSError(28, "No space left on device")
