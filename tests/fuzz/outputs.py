"""The fuzzer's kind `outputs`: where results are to be written, wherever that leads.

No input changes, nothing is left beside, and what is there afterwards is the old content or the new, whole.
"""

import contextlib
import os
import tempfile
from pathlib import Path

import numpy as np

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.output_files import check_outputs, written_beside

_NAMES = (
    "in.yaml",
    "mesh.obj",
    "out.json",
    "page.html",
    "folder",
    "folder/inner",
    "recording",
    "recording/signals.jsonl",
)
_ODD = ("", ".", "..", "/", "/dev/null", "/dev/full", "/proc/self/status", "a\0b", "x" * 300, "[/x]", "a\nb", "\udcff")
_ODD += ("no/such/folder", "link", "hard", "dangling", "round", "folder/../in.yaml", "./out.json", "-", "~", "*", "%s")


def outputs(rng: np.random.Generator) -> None:
    """Checks some outputs against some inputs, and writes those that pass; one of the writers fails in between."""
    with tempfile.TemporaryDirectory() as top, contextlib.chdir(top):
        _fill(Path(top))
        inputs = [Path(str(rng.choice(_NAMES))) for _ in range(rng.integers(1, 4))]
        given = [_path(rng, Path(top)) for _ in range(rng.integers(1, 4))]
        before = _contents(Path(top))
        try:
            check_outputs(given, inputs)
        finally:
            assert _contents(Path(top)) == before, "the check has changed something"
        for path in filter(None, given):
            _write(path, fails=bool(rng.random() < 0.3))
        after = _contents(Path(top))
        for name in inputs:
            for place in (name, *name.rglob("*")) if name.is_dir() else (name,):
                assert after.get(str(place)) == before.get(str(place)), f"the input {place} has changed"
        for place, content in after.items():
            assert content in (before.get(place), b"new"), f"{place} holds {content!r}"


def _write(path: Path, *, fails: bool) -> None:
    with contextlib.suppress(InvalidFileError), written_beside(path) as beside:
        beside.write_bytes(b"ne")
        if fails:
            raise OSError(28, "No space left on device")
        beside.write_bytes(b"new")


def _fill(top: Path) -> None:
    for name in ("folder", "recording"):
        (top / name).mkdir()
    for name in ("in.yaml", "mesh.obj", "folder/inner", "recording/signals.jsonl"):
        (top / name).write_bytes(name.encode())
    (top / "link").symlink_to("in.yaml")
    (top / "dangling").symlink_to("nowhere")
    (top / "round").symlink_to("round")
    os.link(top / "mesh.obj", top / "hard")


def _path(rng: np.random.Generator, top: Path) -> Path | None:
    if rng.random() < 0.1:
        return None
    name = str(rng.choice(_NAMES)) if rng.random() < 0.5 else _ODD[rng.integers(len(_ODD))]
    return top / name if rng.random() < 0.2 else Path(name)


def _contents(top: Path) -> dict[str, bytes]:
    """Of all files but devices, by their names from the top; of a folder, nothing."""
    found = {}
    for path in sorted(top.rglob("*")):
        if path.is_file() and not path.is_symlink():
            found[str(path.relative_to(top))] = path.read_bytes()
        else:
            found[str(path.relative_to(top))] = b"" if not path.is_symlink() else os.readlink(path).encode()
    return found
