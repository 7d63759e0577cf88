import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.schema import Transform
from pydrake.geometry import Meshcat

from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.grasping.pad_grip import PadGrip, PadGripResult, load_pad_grip, simulate_pad_grip
from tactopose_drake.systems.grip_controller import GripControllerParams

RADIUS = 0.0331  # of the can, m
CAN = dataclasses.replace(
    load_pad_grip("barrett_like"),  # a can on its side on the palm, its axis along x of P
    hold_time=0.3,
    controller=GripControllerParams(fixed={"finger_1_spread_joint": 0.0}, closing_speed=2.5),
)


@pytest.fixture(scope="module")
def result() -> PadGripResult:
    meshcat = Meshcat()
    result = simulate_pad_grip(CAN, meshcat)
    assert meshcat.HasPath("/tactopose_patches/3/axes/2")
    assert "set_animation" in meshcat.StaticHtml()
    return result


def test_the_hand_holds_the_can_against_the_palm(result: PadGripResult) -> None:
    assert result.reason == "ok"
    assert result.held
    assert result.slip < 0.002
    np.testing.assert_allclose(result.X_PO.translation(), [-0.057, 0, 0.11], atol=0.002)
    np.testing.assert_allclose(result.q[[0, 3]], 0.0, atol=0.01)
    np.testing.assert_allclose(result.q[[1, 4, 6]], 1.65, atol=0.05)
    assert result.diagram.GetOutputPort("patch_status").Eval(result.simulator.get_context()) == "ok"


def test_every_pad_feels_the_can_where_it_is(result: PadGripResult) -> None:
    assert len(result.patches) == 4
    for patch in result.patches:
        assert patch.status == "area"
        p_OC = result.X_PO.inverse() @ patch.centroid
        radial = np.array([p_OC[0], p_OC[1], 0.0])
        # The mean of a bent patch lies within the can, by a third of the sagitta of its half-width of about 7 mm.
        assert RADIUS - 0.0015 < np.linalg.norm(radial) < RADIUS + 0.0005
        n_O = result.X_PO.rotation().inverse() @ patch.eigenvectors[:, 2]
        assert np.degrees(np.arccos(n_O @ radial / np.linalg.norm(radial))) < 3.0


def test_what_is_not_caught_is_said_to_have_slipped() -> None:
    far = dataclasses.replace(CAN, X_PO=Transform(translation=[0.3, 0.0, 0.2]), closing_time=0.02, hold_time=0.1)
    result = simulate_pad_grip(far)
    assert result.reason == "the fingers did not close in time"
    assert not result.held
    # In its place until released, then in free fall: 25 or 26 steps of 4 ms.
    assert 0.049 < result.slip < 0.056
    assert all(patch.status == "no_contact" for patch in result.patches)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"object": "sodacan"}, "object: .*sodacan.sdf does not exist; the package's objects are .*soda_can"),
        ({"hold_time": 0.0}, "hold_time: is 0"),
        ({"seed": -1}, "seed: is -1"),
        ({"controller": GripControllerParams(period=-1)}, "period: is -1"),
    ],
)
def test_an_impossible_grip_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        simulate_pad_grip(dataclasses.replace(CAN, **values))


def test_a_hand_without_pads_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="has no tactile pads"):
        simulate_pad_grip(dataclasses.replace(CAN, hand="shadow_like", controller=GripControllerParams()))


def test_the_shipped_file_states_the_defaults_that_it_repeats() -> None:
    shipped, default = load_pad_grip("barrett_like"), PadGrip()
    for name in ("hand", "object", "seed", "hold_time", "descriptor"):
        assert getattr(shipped, name) == getattr(default, name)
    assert shipped.controller == dataclasses.replace(default.controller, fixed={"finger_1_spread_joint": 0.0})


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("objct: mug", InvalidFileError, r"grip\.yaml: .*objct"),
        ("object: mugg", InvalidInputError, "object: .*mugg.sdf does not exist"),
    ],
)
def test_an_unusable_file_is_refused(tmp_path: Path, text: str, error: type[Exception], message: str) -> None:
    path = tmp_path / "grip.yaml"
    path.write_text(text)
    with pytest.raises(error, match=message):
        load_pad_grip(path)
