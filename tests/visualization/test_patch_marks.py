import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.visualization.patch_marks import add_patches, move_patches, plate_sizes
from tests.recording_meshcat import RecordingMeshcat

PATH = "/pads"


def make_patch(pressed: list[int], *, saturation: float | None = 1.6e5) -> Patch:
    """On the palm's cells; each pressed one has 10 kPa more than the one before."""
    layout = load_tactile_pad("bh280_palm").layout
    pressure = np.zeros(24)
    pressure[pressed] = 1e4 * (1 + np.arange(len(pressed)))
    return describe_patch(layout.p_TC, pressure, alpha=2e-8, n_PT=layout.n_T, saturation=saturation)


def shown(*patches: Patch) -> RecordingMeshcat:
    meshcat = RecordingMeshcat()
    add_patches(meshcat, PATH, 4, 24)
    move_patches(meshcat, PATH, patches, 4, 24)
    return meshcat


def test_plates_stand_on_the_pressed_cells_with_areas_as_their_pressures() -> None:
    patch = make_patch([6, 7, 13, 14])
    meshcat = shown(patch)
    for cell in range(24):
        at = f"{PATH}/0/cells/{cell}"
        assert meshcat.visible(at) == (cell in (6, 7, 13, 14))
        if meshcat.visible(at):
            np.testing.assert_allclose(meshcat.pose(at).translation(), patch.p_PT[cell])
            np.testing.assert_allclose(meshcat.pose(at).rotation().matrix()[:, 2], patch.n_PT[cell], atol=1e-12)
            edge, _, height = meshcat.properties[at, "scale"]
            assert height == 1.0
            assert edge**2 == pytest.approx(0.0106**2 * patch.pressure[cell] / 1.6e5)


def test_a_saturated_plate_reaches_its_neighbours_and_a_frame_without_range_is_scaled_to_its_largest() -> None:
    beyond = make_patch([6, 7, 13, 14], saturation=2.5e4)
    assert plate_sizes(beyond).max() == pytest.approx(0.0106)
    unlimited = make_patch([6, 7, 13, 14], saturation=None)
    np.testing.assert_allclose(plate_sizes(unlimited)[[6, 14]], [[0.0053, 0.0053], [0.0106, 0.0106]])


def test_plates_on_long_cells_are_as_long() -> None:
    cells = np.array([[0.002 * i, 0.006 * j, 0.0] for i in range(6) for j in range(3)])
    turn = RotationMatrix(RollPitchYaw(0.3, -0.4, 0.5)).matrix()
    patch = describe_patch(cells @ turn.T, np.full(18, 1e4), alpha=1e-8, n_PT=np.tile(turn[:, 2], (18, 1)))
    meshcat = shown(patch)
    np.testing.assert_allclose(meshcat.properties[f"{PATH}/0/cells/4", "scale"], [0.006, 0.002, 1.0])
    pose = meshcat.pose(f"{PATH}/0/cells/4").rotation().matrix()
    np.testing.assert_allclose(np.abs(turn.T @ pose), [[0, 1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-9)


def test_the_axes_are_the_principal_components() -> None:
    patch = make_patch([5, 6, 7, 8, 9, 13, 14])
    meshcat = shown(patch)
    for k in range(3):
        at = f"{PATH}/0/axes/{k}"
        np.testing.assert_allclose(meshcat.pose(at).translation(), patch.centroid)
        np.testing.assert_allclose(meshcat.pose(at).rotation().matrix()[:, 2], patch.eigenvectors[:, k], atol=1e-12)
        length = meshcat.properties[at, "scale"][2]
        assert length == pytest.approx(max(2 * np.sqrt(patch.eigenvalues[k]), 0.004))
    assert meshcat.properties[f"{PATH}/0/axes/0", "scale"][2] > 0.02


def test_only_what_is_known_is_shown() -> None:
    meshcat = shown(make_patch([5, 6]), make_patch([3]), make_patch([]))
    assert [meshcat.visible(f"{PATH}/0/axes/{k}") for k in range(3)] == [True, False, False]
    assert [meshcat.visible(f"{PATH}/1/axes/{k}") for k in range(3)] == [False, False, False]
    assert meshcat.visible(f"{PATH}/1/cells/3")
    assert not meshcat.visible(f"{PATH}/2")
    assert not meshcat.visible(f"{PATH}/3"), "of four pads three gave a patch"
    assert f"{PATH}/4/axes/0" not in meshcat.objects
