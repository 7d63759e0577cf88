import re
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.poses import make_poses, matrix_from_quaternion, transform_points
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation import load_prior
from tactopose_drake.hand import load_hand_volume
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.hand.touch_file import load_touch

QUATERNION = [0.5, 0.5, -0.5, 0.5]
X_PT = make_poses(matrix_from_quaternion(np.array(QUATERNION)), np.array([0.01, 0.02, 0.03]))
POSE = f"{{translation: [0.01, 0.02, 0.03], quaternion_wxyz: {QUATERNION}}}"
CELLS = "[[0, 0, 0], [0.004, 0, 0], [0, 0.004, 0], [0.004, 0.004, 0]]"
PAD = f"points: {CELLS}, pressures: [0, 2e4, 1e4, null], alpha: 2e-8"


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "touch.yaml"
    path.write_text(text)
    return path


def test_cells_are_read_in_the_pads_frame(tmp_path: Path) -> None:
    touch = load_touch(write(tmp_path, f"patches: [{{{PAD}, X_PT: {POSE}, threshold: 100, saturation: 1.5e4}}]"))
    assert len(touch.contacts) == 0
    (patch,) = touch.patches
    cells = np.array([[0, 0, 0], [0.004, 0, 0], [0, 0.004, 0], [0.004, 0.004, 0]])
    np.testing.assert_allclose(patch.p_PT, transform_points(X_PT, cells), atol=1e-15)
    np.testing.assert_allclose(patch.n_PT, np.tile(X_PT[:, 2], (4, 1)), atol=1e-15)
    np.testing.assert_array_equal(patch.pressure, [0.0, 2e4, 1e4, np.nan])
    assert (patch.alpha, patch.threshold, patch.saturation) == (2e-8, 100.0, 1.5e4)
    np.testing.assert_array_equal(patch.active, [False, True, True, False])
    np.testing.assert_array_equal(patch.saturated, [False, True, False, False])


def test_normals_may_be_given_and_the_frame_left_out(tmp_path: Path) -> None:
    normals = "[[0, 0, -1], [0, 0, -1], [0, 1, 0], [0, 1, 0]]"
    (patch,) = load_touch(write(tmp_path, f"patches: [{{{PAD}, normals: {normals}}}]")).patches
    np.testing.assert_array_equal(patch.n_PT, [[0, 0, -1], [0, 0, -1], [0, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(patch.p_PT[3], [0.004, 0.004, 0.0])
    assert patch.threshold == 0.0
    assert patch.saturation == np.inf


def test_an_array_is_known_by_its_name_or_by_a_file_beside(tmp_path: Path) -> None:
    pad = load_tactile_pad("bh280_palm")
    pressure = np.linspace(0.0, 1e5, len(pad.layout))
    read = f"pressures: {pressure.tolist()}, alpha: 1e-8, X_PT: {POSE}"
    (patch,) = load_touch(write(tmp_path, f"patches: [{{array: bh280_palm, {read}}}]")).patches
    p_PT, n_PT = transform_points(X_PT, pad.layout.p_TC), pad.layout.n_T @ X_PT[:, :3].T
    expected = describe_patch(p_PT, pressure, alpha=1e-8, n_PT=n_PT, saturation=pad.model.range)
    np.testing.assert_array_equal(patch.centroid, expected.centroid)
    np.testing.assert_array_equal(patch.eigenvectors, expected.eigenvectors)
    assert patch.saturation == expected.saturation
    (tmp_path / "pad.yaml").write_text(f"pattern: !PointPattern {{points: {CELLS}, cell: 0.004}}")
    text = "patches: [{array: pad.yaml, pressures: [1, 2, 3, 4], alpha: 1e-8}]"
    assert len(load_touch(write(tmp_path, text)).patches[0].p_PT) == 4


def test_cells_that_an_arrays_file_calls_dead_do_not_count(tmp_path: Path) -> None:
    model = "model: {range: 2e5, dead_cells: [2]}"
    (tmp_path / "pad.yaml").write_text(f"pattern: !PointPattern {{points: {CELLS}, cell: 0.004}}\n{model}")
    text = "patches: [{array: pad.yaml, pressures: [1e4, 2e4, 9e5, 0], alpha: 1e-8}]"
    (patch,) = load_touch(write(tmp_path, text)).patches
    np.testing.assert_array_equal(patch.pressure, [1e4, 2e4, np.nan, 0.0])
    text = "patches: [{array: pad.yaml, pressures: [1e4, 9e5, 9e5, 0], alpha: 1e-8}]"
    message = r"patches\[0\].pressures\[1\] must be a number up to the array's range, 200000 Pa, .*, not 900000"
    with pytest.raises(InvalidFileError, match=message):
        load_touch(write(tmp_path, text))


def test_contacts_and_patches_go_together(tmp_path: Path) -> None:
    text = f"contacts: [{{position: [0, 0, 0.1]}}]\nsigma_position: 0.002\npatches: [{{{PAD}}}, {{{PAD}}}]"
    touch = load_touch(write(tmp_path, text))
    np.testing.assert_array_equal(touch.contacts.p_PC, [[0.0, 0.0, 0.1]])
    np.testing.assert_array_equal(touch.contacts.sigma_position, 0.002)
    assert len(touch.patches) == 2


def test_planes_that_the_object_touches_are_read(tmp_path: Path) -> None:
    text = "contacts: [{position: [0, 0, 0.1]}]\nplanes: [{point: [0, 0, 0.2], normal: [0, 0, -1], sigma: 0.003}, "
    first, second = load_touch(write(tmp_path, text + "{point: [0, 1, 0], normal: [0, 1, 0]}]")).planes
    assert first == PlaneContact(np.array([0.0, 0.0, 0.2]), np.array([0.0, 0.0, -1.0]), 0.003)
    assert second == PlaneContact(np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0]))


def test_the_files_of_the_reference_can_be_read(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "reference" / "touch_files.md").read_text()
    readers = {"contacts": load_touch, "prior": load_prior, "volume": load_hand_volume, "spheres": load_hand_volume}
    files = re.findall(r"```yaml\n# (\w+)\.yaml\n(.*?)```", text, re.DOTALL)
    assert [name for name, _ in files] == list(readers)
    read = {name: readers[name](write(tmp_path, content)) for name, content in files}
    assert [patch.status for patch in read["contacts"].patches] == ["area", "row"]
    assert [plane.sigma for plane in read["contacts"].planes] == [0.002]
    assert read["volume"].untouched is not None
    assert len(read["spheres"].untouched.radius) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sigma_position: 0.001", "must have contacts, patches or both, but has neither"),
        ("touches: []", "must have only the keys contacts, patches, planes, sigma_position.*, not 'touches'"),
        ("planes: [{point: [0, 0, 0], normal: [0, 0, 1]}]", "must have contacts, patches or both, but has neither"),
        (
            "contacts: [{position: [0, 0, 0]}]\nplanes: [{point: [0, 0, 0]}]",
            r"planes\[0\] must have the key 'normal', but lacks it",
        ),
        (
            "contacts: [{position: [0, 0, 0]}]\nplanes: [{point: [0, 0, 0], normal: [0, 0, 3]}]",
            r"planes\[0\].normal must have the length",
        ),
        ("patches: {}", "patches must be a list of at least one patch, not {}"),
        ("patches: [3]", r"patches\[0\] must be a mapping with the keys points, pressures, alpha, .*, not 3"),
        (f"patches: [{{{PAD}, depth: 2}}]", r"patches\[0\] must have only the keys .*, not 'depth'"),
        (f"patches: [{{{PAD}, array: bh280_palm}}]", r"patches\[0\] must have only the keys array.*, not 'points'"),
        (f"patches: [{{points: {CELLS}, alpha: 1e-8}}]", r"patches\[0\] must have the key 'pressures', but lacks it"),
        (
            f"patches: [{{points: {CELLS}, pressures: [1, 2], alpha: 1e-8}}]",
            r"patches\[0\].pressures must be 4, one for each cell of the pad, not 2",
        ),
        (
            f"patches: [{{points: {CELLS}, pressures: [1, 2, x, 3], alpha: 1e-8}}]",
            r"patches\[0\].pressures\[2\] must be a number, not 'x'",
        ),
        (
            f"patches: [{{points: {CELLS}, pressures: [1, 2, -1, 3], alpha: 1e-8}}]",
            r"patches\[0\].pressures\[2\] must be a number >= 0, or NaN, not -1",
        ),
        (
            f"patches: [{{points: {CELLS}, pressures: [null, null, null, null], alpha: 1e-8}}]",
            r"patches\[0\].pressures must be known at one cell or more",
        ),
        (
            "patches: [{points: [[0, 0]], pressures: [1], alpha: 0}]",
            r"points\[0\] must have the shape \(3,\), not \(2,",
        ),
        (f"patches: [{{{PAD}, normals: [[0, 0, 1]]}}]", r"patches\[0\].normals must have the shape .*, not \(1, 3\)"),
        (
            f"patches: [{{{PAD}, X_PT: {{translation: [0, 0, 0]}}}}]",
            r"X_PT must have the key 'quaternion_wxyz', but lacks it",
        ),
        ("patches: [{array: 7, pressures: [1], alpha: 0}]", r"array must be a name or a path, not 7"),
        (
            "patches: [{array: none.yaml, pressures: [1], alpha: 0}]",
            r"patches\[0\].array: .*none.yaml must be .*, but there is no such",
        ),
        (
            "patches: [{array: foo, pressures: [1], alpha: 0}]",
            r"foo must be .*, bh280_finger, bh280_palm, fingertip_1mm, but",
        ),
        (f"patches: [{{{PAD}, threshold: yes}}]", r"patches\[0\].threshold must be a number, not True"),
    ],
)
def test_each_fault_is_one_line_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InvalidFileError, match=message) as caught:
        load_touch(path)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
