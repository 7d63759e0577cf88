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
        ("contacts: [", r"file.yaml: is not YAML at line 2, column 1"),
        ("3", "is 3; allowed is a mapping with the keys contacts, sigma_position, sigma_normal_deg"),
        ("contacts: []", r"contacts: is \[\]; allowed is a list of at least one contact"),
        ("touches: []", "key 'touches' is unknown; allowed are contacts"),
        ("sigma_position: 1.0", "key 'contacts' is missing"),
        ("contacts: [7]", r"contacts\[0\]: is 7; allowed is a mapping with the keys position"),
        ("contacts: [{normal: [0, 0, 1]}]", r"contacts\[0\]: key 'position' is missing"),
        ("contacts: [{position: [0, 0]}]", r"contacts\[0\].position: has shape \(2,\); allowed is \(3,\)"),
        ("contacts: [{position: [0, 0, 0], normal: [0, 1]}]", r"contacts\[0\].normal: has shape \(2,\)"),
        ("contacts: [{position: [0, .nan, 0]}]", r"contacts\[0\].position\[1\]: is nan; allowed are finite numbers"),
        ("contacts: [{position: [a, b, c]}]", r"contacts\[0\].position\[0\]: is 'a'; allowed are numbers"),
        ("contacts: [{position: [0, 0, 0], normal: [0, 0, 2]}]", r"contacts\[0\].normal: has length 2; allowed is 1"),
        (
            "contacts: [{position: [0, 0, 0.1]}, {position: [31, 2, 94]}]",
            r"contacts\[1\].position: is \[31.0, 2.0, 94.0\], in metres; .* Multiply by 0.001",
        ),
        ("contacts: [{position: [0, 0, 0], force: [0, 1.0e+9, 0]}]", r"contacts\[0\].force: is 1e\+09"),
        ("{contacts: [{position: [0, 0, 0]}], sigma_normal_deg: -1}", "sigma_normal_deg, in rad: is -0.0174533"),
        (
            "contacts: [{position: [0, 0, 0], normal: [0, 0, 1]}, {position: [0, 0, 0]}]",
            r"contacts\[1\]: has no normal, but contacts\[0\] has",
        ),
        ("{contacts: [{position: [0, 0, 0]}], sigma_position: -1}", "sigma_position: is -1; allowed are numbers > 0"),
        ("{contacts: [{position: [0, 0, 0]}], sigma_position: .nan}", "file.yaml: sigma_position: is nan; allowed are"),
        ("{contacts: [{position: [0, 0, 0]}], sigma_position: yes}", "sigma_position: is True; allowed are numbers"),
        ("contacts: [{position: [0, true, 0]}]", r"position\[1\]: is True; allowed are numbers"),
        ("contacts: [{position: ['0', 0, 0]}]", r"position\[0\]: is '0'; allowed are numbers"),
        ("contacts: [{position: [2020-13-45, 0, 0]}]", r"position\[0\]: is '2020-13-45'; allowed are numbers"),
        ("contacts: [{position: [[0], [0], 0]}]", r"position\[0\]: is \[0\]; allowed are numbers"),
        ("contacts: [{position: [0, 0, 0], position: [1, 0, 0]}]", "line 1: key 'position' is given twice"),
        ("contacts: [{position: [1" + "0" * 400 + ", 0, 0]}]", r"line 1: contacts\[0\].position\[0\]: is '100000"),
        ("{contacts: [{position: [0, 0, 0]}], sigma_normal_deg: x}", "sigma_normal_deg: is 'x'; allowed are numbers"),
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
        ("X_PO: {translation: [0, 0, 0]}", "X_PO: key 'quaternion_wxyz' is missing"),
        ("X_PO: {translation: [0, 0], quaternion_wxyz: [1, 0, 0, 0]}", r"X_PO.translation: has shape \(2,\)"),
        ("X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 1, 0, 0]}", "quaternion_wxyz: has length 1.41421"),
        ("{X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}, sigma: 1}", "key 'sigma' is unknown"),
        (
            "{X_PO: {translation: [0, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}, sigma_translation: 0}",
            "sigma_translation: is 0; allowed are numbers > 0",
        ),
        (
            "X_PO: {translation: [-30, 10, 110], quaternion_wxyz: [1, 0, 0, 0]}",
            r"X_PO.translation: is \[-30.0, 10.0, 110.0\], in metres; .* Multiply by 0.001",
        ),
    ],
)
def test_each_fault_of_a_prior_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InvalidFileError, match=message):
        load_prior(write(tmp_path, text))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match=r"absent.yaml: cannot be read \(No such file or directory\)"):
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
