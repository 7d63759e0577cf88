import json
import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.files import load_contacts, load_prior, save_result
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate

CONTACTS = """
contacts:
- {position: [0.031, 0.002, 0.094], normal: [0.0, -1.0, 0.0], force: [0.0, -2.1, 0.3]}
- {position: [0.031, 0.052, 0.094], normal: [0.0, 1.0, 0.0], force: [0.0, 2.1, 0.3]}
sigma_position: 0.0005
sigma_normal_deg: 3.0
"""
PRIOR = """
X_PO: {translation: [0.1, 0.2, 0.3], quaternion_wxyz: [0.0, 1.0, 0.0, 0.0]}
sigma_translation: 0.02
sigma_rotation_deg: 10.0
"""


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    return path


def test_contacts_are_read(tmp_path: Path) -> None:
    contacts = load_contacts(write(tmp_path, CONTACTS))
    np.testing.assert_array_equal(contacts.p_PC, [[0.031, 0.002, 0.094], [0.031, 0.052, 0.094]])
    np.testing.assert_array_equal(contacts.n_PC, [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_array_equal(contacts.f_PC, [[0.0, -2.1, 0.3], [0.0, 2.1, 0.3]])
    np.testing.assert_array_equal(contacts.sigma_position, 0.0005)
    np.testing.assert_allclose(contacts.sigma_normal, math.radians(3.0))


def test_what_is_absent_keeps_its_default(tmp_path: Path) -> None:
    contacts = load_contacts(write(tmp_path, "contacts: [{position: [0, 0, 0]}]"))
    assert contacts.n_PC is None
    assert contacts.f_PC is None
    np.testing.assert_array_equal(contacts.sigma_position, 0.0009)


def test_a_prior_is_read(tmp_path: Path) -> None:
    prior = load_prior(write(tmp_path, PRIOR))
    np.testing.assert_allclose(
        prior.X_PO.GetAsMatrix34(), [[1, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, 0.3]], atol=1e-15
    )
    assert prior.sigma_translation == 0.02
    assert prior.sigma_rotation == pytest.approx(math.radians(10.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("contacts: [", r"file.yaml: the content is not YAML at line 2, column 1"),
        ("3", "the content must be a mapping with the keys contacts, sigma_position, sigma_normal_deg, not 3"),
        ("contacts: []", r"contacts must be a list of at least one contact, not \[\]"),
        ("touches: []", "must have only the keys contacts.*, not 'touches'"),
        ("sigma_position: 1.0", "the content must have the key 'contacts', but lacks it"),
        ("contacts: [7]", r"contacts\[0\] must be a mapping with the keys position, .*, not 7"),
        ("contacts: [{normal: [0, 0, 1]}]", r"contacts\[0\] must have the key 'position', but lacks it"),
        ("contacts: [{position: [0, 0]}]", r"contacts\[0\].position must have the shape \(3,\), not \(2,\)"),
        (
            "contacts: [{position: [0, 0, 0], normal: [0, 1]}]",
            r"contacts\[0\].normal must have the shape .*, not \(2,\)",
        ),
        ("contacts: [{position: [0, .nan, 0]}]", r"contacts\[0\].position\[1\] must be a finite number, not nan"),
        ("contacts: [{position: [a, b, c]}]", r"contacts\[0\].position\[0\] must be a number, not 'a'"),
        (
            "contacts: [{position: [0, 0, 0], normal: [0, 0, 2]}]",
            r"contacts\[0\].normal must have the length 1 .*, not 2",
        ),
        (
            "contacts: [{position: [0, 0, 0.1]}, {position: [31, 2, 94]}]",
            r"contacts\[1\].position must have .*, not \[31.0, 2.0, 94.0\] m. Multiply by 0.001",
        ),
        ("contacts: [{position: [0, 0, 0], force: [0, 1.0e+9, 0]}]", r"contacts\[0\].force must be .*, not 1e\+09"),
        (
            "{contacts: [{position: [0, 0, 0]}], sigma_normal_deg: -1}",
            r"file.yaml: sigma_normal_deg must be a number > 0, not -1\.$",
        ),
        (
            "contacts: [{position: [0, 0, 0], normal: [0, 0, 1]}, {position: [0, 0, 0]}]",
            r"contacts must all have a normal, or none, but contacts\[0\] has one and contacts\[1\] has none",
        ),
        ("{contacts: [{position: [0, 0, 0]}], sigma_position: -1}", "sigma_position must be a number > 0, not -1"),
        (
            "{contacts: [{position: [0, 0, 0]}], sigma_position: .nan}",
            "file.yaml: sigma_position must be a finite number, not nan",
        ),
        ("{contacts: [{position: [0, 0, 0]}], sigma_position: yes}", "sigma_position must be a number, not True"),
        ("contacts: [{position: [0, true, 0]}]", r"position\[1\] must be a number, not True"),
        ("contacts: [{position: ['0', 0, 0]}]", r"position\[0\] must be a number, not '0'"),
        ("contacts: [{position: [2020-13-45, 0, 0]}]", r"position\[0\] must be a number, not '2020-13-45'"),
        ("contacts: [{position: [[0], [0], 0]}]", r"contacts\[0\].position must consist of numbers \("),
        (
            "contacts: [{position: [0, 0, 0], position: [1, 0, 0]}]",
            "line 1: the key 'position' must be given once, not twice",
        ),
        (
            "contacts: [{position: [1" + "0" * 400 + ", 0, 0]}]",
            r"line 1: contacts\[0\].position\[0\] must be an integer of 64 bits, not '100000",
        ),
        (
            "{contacts: [{position: [0, 0, 0]}], sigma_normal_deg: 0.0001}",
            r"file.yaml: sigma_normal_deg must be a number from 0.000572958 to 5.72958e\+07 deg, not 0.0001\.$",
        ),
        ("{contacts: [{position: [0, 0, 0]}], sigma_normal_deg: x}", "sigma_normal_deg must be a number, not 'x'"),
    ],
)
def test_each_fault_of_contacts_is_one_line_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InvalidFileError, match=message) as caught:
        load_contacts(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).count(str(path)) == 1
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("X_PO: {translation: [0, 0, 0]}", "X_PO must have the key 'quaternion_wxyz', but lacks it"),
        (
            "X_PO: {translation: [0, 0], quaternion_wxyz: [1, 0, 0, 0]}",
            r"X_PO.translation must have the shape .*, not \(2,\)",
        ),
        (
            "X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 1, 0, 0]}",
            "quaternion_wxyz must have the length 1 within 0.001, not 1.41421",
        ),
        (
            "{X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}, sigma: 1}",
            "the content must have only the keys X_PO, .*, not 'sigma'",
        ),
        (
            "{X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}, sigma_translation: 0}",
            "sigma_translation must be a number > 0, not 0",
        ),
        (
            "X_PO: {translation: [-30, 10, 110], quaternion_wxyz: [1, 0, 0, 0]}",
            r"X_PO.translation must have .*, not \[-30.0, 10.0, 110.0\] m. Multiply by 0.001",
        ),
        (
            "{X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}, sigma_rotation_deg: 1e5}",
            r"file.yaml: sigma_rotation_deg must be a number from 5.72958e-05 to 57295.8 deg, not 100000\.$",
        ),
    ],
)
def test_each_fault_of_a_prior_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InvalidFileError, match=message):
        load_prior(write(tmp_path, text))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match=r"absent.yaml cannot be read \(No such file or directory\)"):
        load_contacts(tmp_path / "absent.yaml")


def test_a_result_is_written_as_the_format_says(tmp_path: Path) -> None:
    X_PO = RigidTransform(RollPitchYaw(0.0, 0.0, math.pi / 2), [0.1, 0.2, 0.3])
    hypothesis = PoseHypothesis(X_PO, 1.5, 1.0, np.eye(6), np.eye(6)[2:3], inlier_probability=np.array([0.9, 0.2]))
    path = tmp_path / "result.json"
    save_result(path, PoseEstimate((hypothesis,), "ok", 0.002))
    result = json.loads(path.read_text())
    assert result["status"] == "ok"
    assert result["duration"] == 0.002
    (written,) = result["hypotheses"]
    assert written["translation"] == [0.1, 0.2, 0.3]
    np.testing.assert_allclose(written["quaternion_wxyz"], [math.sqrt(0.5), 0, 0, math.sqrt(0.5)], atol=1e-15)
    assert written["cost"] == 1.5
    assert written["probability"] == 1.0
    np.testing.assert_array_equal(written["covariance"], np.eye(6))
    assert written["inlier_probability"] == [0.9, 0.2]
    with pytest.raises(InvalidFileError, match="cannot be written"):
        save_result(tmp_path / "absent" / "result.json", PoseEstimate((hypothesis,), "ok", 0.002))
