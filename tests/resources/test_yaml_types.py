import dataclasses
from pathlib import Path

import pytest

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.resources import load_typed_yaml, yaml_types


@dataclasses.dataclass(kw_only=True, slots=True)
class Box:
    """What the files of these tests hold."""

    sides: list[float] = dataclasses.field(default_factory=lambda: [1.0])


def test_what_was_read_before_is_neither_shared_nor_stale(tmp_path: Path) -> None:
    path = tmp_path / "box.yaml"
    path.write_text("sides: [1.0, 2.0]")
    first = load_typed_yaml(Box, path)
    first.sides.append(3.0)
    assert load_typed_yaml(Box, path).sides == [1.0, 2.0]
    path.write_text("sides: [4.0]")
    assert load_typed_yaml(Box, path).sides == [4.0]
    path.write_text("sides: 4.0")
    for _ in range(2):
        with pytest.raises(InvalidFileError, match=r"box.yaml: line 1: sides must be a list, not"):
            load_typed_yaml(Box, path)


def test_what_the_check_takes_is_read(tmp_path: Path) -> None:
    """Libyaml takes a tab for white space, which the parser that Drake uses does not."""
    path = tmp_path / "box.yaml"
    path.write_text("sides:\t[1.0,\t2.0]\t# in metres\n")
    assert load_typed_yaml(Box, path).sides == [1.0, 2.0]
    path.write_text("_side: &side 0.25\nsides: [*side, *side, 1e-1]\n")
    assert load_typed_yaml(Box, path).sides == [0.25, 0.25, 0.1]


def test_a_text_is_read_by_drakes_loader_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[object] = []
    read = yaml_types.yaml_load_typed
    monkeypatch.setattr(yaml_types, "yaml_load_typed", lambda **options: calls.append(options) or read(**options))
    for name in ("one.yaml", "two.yaml"):
        (tmp_path / name).write_text("sides: [5.0, 6.0, 7.0]")
        load_typed_yaml(Box, tmp_path / name)
    assert len(calls) == 1
