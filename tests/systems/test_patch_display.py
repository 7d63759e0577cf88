import dataclasses

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.analysis import Simulator
from tactopose_drake.systems.patch_display import PatchDisplay, PatchDisplayParams

from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import Hand, add_hand, load_hand_config, make_hand_plant
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.visualization.patch_marks import plate_edges
from tests.recording_meshcat import RecordingMeshcat

PATH = "/tactopose_patches"
X_WPalm = RigidTransform(RollPitchYaw(1.3, -0.2, 0.7), [1.0, 2.0, 3.0])


@pytest.fixture(scope="module")
def hand() -> Hand:
    return make_hand_plant(load_hand_config("barrett_like"))[1]


def make_patch(pressed: list[int], *, saturation: float | None = 1.6e5) -> Patch:
    """On the palm's cells; each pressed one has 10 kPa more than the one before."""
    layout = load_tactile_pad("bh280_palm").layout
    pressure = np.zeros(24)
    pressure[pressed] = 1e4 * (1 + np.arange(len(pressed)))
    return describe_patch(layout.p_TC, pressure, alpha=2e-8, n_PT=layout.n_T, saturation=saturation)


def run(display: PatchDisplay, patches: tuple[Patch, ...], duration: float = 0.001, **inputs: object) -> None:
    simulator = Simulator(display)
    for name, value in ({"patches": patches} | inputs).items():
        display.GetInputPort(name).FixValue(simulator.get_mutable_context(), AbstractValue.Make(value))
    simulator.Initialize()
    simulator.AdvanceTo(duration)


def test_plates_stand_on_the_pressed_cells_with_areas_as_their_pressures(hand: Hand) -> None:
    meshcat, patch = RecordingMeshcat(), make_patch([6, 7, 13, 14])
    run(PatchDisplay(meshcat, hand), (patch,))
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
    assert plate_edges(beyond).max() == pytest.approx(0.0106)
    unlimited = make_patch([6, 7, 13, 14], saturation=None)
    np.testing.assert_allclose(plate_edges(unlimited)[[6, 14]], [0.0053, 0.0106])


def test_the_axes_are_the_principal_components(hand: Hand) -> None:
    meshcat, patch = RecordingMeshcat(), make_patch([5, 6, 7, 8, 9, 13, 14])
    run(PatchDisplay(meshcat, hand), (patch,))
    for k in range(3):
        at = f"{PATH}/0/axes/{k}"
        np.testing.assert_allclose(meshcat.pose(at).translation(), patch.centroid)
        np.testing.assert_allclose(meshcat.pose(at).rotation().matrix()[:, 2], patch.eigenvectors[:, k], atol=1e-12)
        length = meshcat.properties[at, "scale"][2]
        assert length == pytest.approx(max(2 * np.sqrt(patch.eigenvalues[k]), 0.004))
    assert meshcat.properties[f"{PATH}/0/axes/0", "scale"][2] > 0.02


def test_only_what_is_known_is_shown(hand: Hand) -> None:
    meshcat = RecordingMeshcat()
    run(PatchDisplay(meshcat, hand), (make_patch([5, 6]), make_patch([3]), make_patch([])))
    assert [meshcat.visible(f"{PATH}/0/axes/{k}") for k in range(3)] == [True, False, False]
    assert [meshcat.visible(f"{PATH}/1/axes/{k}") for k in range(3)] == [False, False, False]
    assert meshcat.visible(f"{PATH}/1/cells/3")
    assert not meshcat.visible(f"{PATH}/2")
    assert not meshcat.visible(f"{PATH}/3"), "the hand has four pads, and three gave a patch"
    assert f"{PATH}/4/axes/0" not in meshcat.objects


def test_patches_move_with_the_palm_at_the_simulations_time() -> None:
    plant = MultibodyPlant(0.001)
    hand = add_hand(plant, load_hand_config("barrett_like"))
    X_PalmP = RigidTransform(RollPitchYaw(0.0, 0.5, 0.0), [0.0, 0.0, 0.05])
    palm_frame = plant.AddFrame(FixedOffsetFrame("P", hand.palm_frame, X_PalmP))
    plant.Finalize()
    meshcat, patch = RecordingMeshcat(), make_patch([6, 7, 13, 14])
    poses = [RigidTransform(), X_WPalm, *[RigidTransform()] * 12]
    display = PatchDisplay(meshcat, dataclasses.replace(hand, palm_frame=palm_frame), PatchDisplayParams(period=0.25))
    run(display, (patch,), duration=0.6, body_poses=poses)
    expected = X_WPalm @ X_PalmP @ patch.centroid
    np.testing.assert_allclose(meshcat.pose(f"{PATH}/0/axes/0").translation(), expected)
    assert {time for time in meshcat.times if time is not None} == {0.0, 0.25, 0.5}


def test_meshcat_itself_takes_and_records_all_of_it(hand: Hand) -> None:
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    meshcat.StartRecording()
    run(PatchDisplay(meshcat, hand), (make_patch([6, 7, 13, 14]),), duration=0.1)
    meshcat.PublishRecording()
    assert meshcat.HasPath(f"{PATH}/0/cells/6")
    assert meshcat.HasPath(f"{PATH}/3/axes/2")
    assert "set_animation" in meshcat.StaticHtml()


def test_impossible_displays_are_refused(hand: Hand) -> None:
    with pytest.raises(InvalidInputError, match=r"PatchDisplayParams\.period: is 0"):
        PatchDisplay(RecordingMeshcat(), hand, PatchDisplayParams(period=0.0))
    with pytest.raises(InvalidInputError, match="has no tactile pads"):
        PatchDisplay(RecordingMeshcat(), make_hand_plant(load_hand_config("shadow_like"))[1])
