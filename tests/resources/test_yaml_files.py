import math
import os
from pathlib import Path

import pytest
import yaml

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.resources.yaml_files import MAX_BYTES, MAX_DEPTH, plain_data, read_yaml


def read(folder: Path, text: str | bytes) -> object:
    path = folder / "file.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    root = read_yaml(path)
    return plain_data(root)


def laughs(levels: int) -> str:
    """A list that is ten times as long on each level."""
    lines = ["a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("a: [1, -2.5, 1e-8, 0x20, .5, 3.]", {"a": [1, -2.5, 1e-8, 32, 0.5, 3.0]}),
        ("a: [.inf, -.Inf, -.INF]", {"a": [math.inf, -math.inf, -math.inf]}),
        ("{a: yes, b: null, c: '1', d: 2026-11-22}", {"a": True, "b": None, "c": "1", "d": "2026-11-22"}),
        ("b: &b {x: 1, y: 2}\na: {<<: *b, y: 3}\n", {"b": {"x": 1, "y": 2}, "a": {"x": 1, "y": 3}}),
        ("\ufeffa: \u00fc", {"a": "\u00fc"}),
        ("", None),
    ],
)
def test_what_is_read(tmp_path: Path, text: str, data: object) -> None:
    assert read(tmp_path, text) == data


def test_safe_text_reads_as_yaml_itself_has_it(tmp_path: Path) -> None:
    data = {"text": ["a", "b c", ""], "numbers": [0, 1, -3, 2.5, 1.0e-8, 1e-300], "more": {"no": False, "nil": None}}
    assert read(tmp_path, yaml.safe_dump(data)) == data


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("a: 1\nb: 2\na: 3", "line 3: the key 'a' must be given once, not twice."),
        ("a: {b: 1, b: 2}", "line 1: the key 'b' must be given once, not twice"),
        ("a: !!int abc", "line 1: a must be a number, not 'abc'."),
        ("a: " + "9" * 400, "line 1: a must be an integer of 64 bits, not '999"),
        ("a: 1" + "0" * 400 + ".0", "line 1: a must be a number from -1e+15 to 1e+15, not '1000"),
        ("a: 010", "must be a number, not '010'."),
        ("a: 12:30", "must be a number, not '12:30'."),
        ("a: 1_000", "must be a number, not '1_000'."),
        ("a: !Toy {}", "line 1: a must have no tag, not !Toy."),
        (
            "a: !!python/object/apply:os.system [ls]",
            "line 1: the tag must be one of plain data, not tag:yaml.org,2002:python/object/apply",
        ),
        ("a: !!binary aGk=", "the tag must be one of plain data, not tag:yaml.org,2002:binary."),
        ("a: &a [*a]", "line 1: *a stands for nothing before it."),
        ("a: *b", "*b stands for nothing"),
        ("a: *" + "b" * 5000, "bbb... stands for nothing"),
        ("a: " + "b" * 5000, "bbb... must have at most 1000 letters, not 5000"),
        ("[" * 3000 + "]" * 3000, f"values must be nested at most {MAX_DEPTH} deep, not deeper"),
        ("- " * 3000 + "1", f"values must be nested at most {MAX_DEPTH} deep, not deeper"),
        (laughs(9), "the file must hold at most 200000 values, not more"),
        ("? [1]\n: 2", "line 1: a key must be text, not a list or mapping."),
        ("1: 2", "line 1: the content must have keys of text, in quotes if need be, not 1."),
        ("a: 1\n---\nb: 2", "line 2: the file must hold 1 document, not begin a second one"),
        ('a: "\\x1b[31m"', "must be in one line, and without control characters"),
        ("<<: 3", "line 1: << must merge mappings only."),
        (b"a: \xff", "is not text in UTF-8, at byte 3"),
        ("a: 1".encode("utf-16"), "is not text in UTF-8"),
        ("a: \x00", "is not YAML"),
        ("a: [", "is not YAML at line"),
        ("#" * (MAX_BYTES + 1), f"must have at most {MAX_BYTES} bytes, not more"),
    ],
)
def test_a_fault_is_one_line_and_told_at_once(tmp_path: Path, text: str | bytes, fault: str) -> None:
    with pytest.raises(InvalidFileError) as caught:
        read(tmp_path, text)
    message = str(caught.value)
    assert fault in message
    assert "\n" not in message
    assert len(message) < 500


def test_what_cannot_be_opened_is_told(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="cannot be read"):
        read_yaml(tmp_path)
    with pytest.raises(InvalidFileError, match="cannot be read"):
        read_yaml(Path(os.fspath(tmp_path / "a\0b")))
    with pytest.raises(InvalidFileError, match="cannot be read"):
        read_yaml(tmp_path / ("x" * 400))
    with pytest.raises(InvalidFileError, match="must have at most 1048576 bytes, not more"):
        read_yaml(Path("/dev/zero"))
