"""Noise of depth images, and how images and poses agree, by their definitions."""

import dataclasses

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.poses import make_poses
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_pictures import (
    DepthCameraModel,
    DepthPicture,
    expected_picture,
    fit_to_picture,
    noisy_depth,
    rays,
    take_picture,
)
from tactopose_drake.errors import InvalidInputError
from tests.core.vision.seen_scenes import NO_HAND

CAMERA = DepthCameraModel(width=60, height=40, focal_length=60.0)
X_CO = make_poses(np.eye(3), np.array([0.0, 0.0, 0.55]))


@pytest.fixture(scope="module")
def block() -> ObjectModel:
    """Whose face is half a metre before the camera, across its axis."""
    return ObjectModel.from_mesh(trimesh.creation.box([0.12, 0.09, 0.1]), cache=False)


def empty() -> DepthPicture:
    return DepthPicture(np.full((40, 60), np.inf), np.zeros((40, 60), dtype=bool), CAMERA)


def test_pixels_see_along_their_rays(block: ObjectModel) -> None:
    """The middle of the image is on the axis, and a pixel is 1 / focal length wide at a depth of one."""
    seen = rays(CAMERA)
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(np.diff(seen, axis=1)[..., 0], 1.0 / 60.0)
    np.testing.assert_allclose(np.diff(seen, axis=0)[..., 1], 1.0 / 60.0)
    face = expected_picture(block, X_CO, empty())
    is_seen = np.isfinite(face.depth)
    np.testing.assert_allclose(face.depth[is_seen], 0.5, rtol=1e-6)
    across, down = 0.5 * np.moveaxis(seen[..., :2], -1, 0)
    np.testing.assert_array_equal(is_seen, (np.abs(across) < 0.06) & (np.abs(down) < 0.045))


def test_a_cropped_image_shows_what_the_whole_one_shows_there(block: ObjectModel) -> None:
    """The axis of the whole camera meets it beside the crop, which begins at column 35 and row 4."""
    crop = dataclasses.replace(CAMERA, width=20, height=30, center_x=29.5 - 35.0, center_y=19.5 - 4.0)
    crop.validate()
    part = np.s_[4:34, 35:55]
    np.testing.assert_allclose(rays(crop), rays(CAMERA)[part], atol=1e-12)
    nothing = DepthPicture(np.full((30, 20), np.inf), np.zeros((30, 20), dtype=bool), crop)
    whole, seen = (expected_picture(block, X_CO, each).depth for each in (empty(), nothing))
    assert 0 < np.isfinite(seen).sum() < seen.size
    np.testing.assert_allclose(seen, whole[part], rtol=1e-6)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_noise_is_as_large_as_is_told_and_a_share_of_it_is_common(share: float) -> None:
    camera = dataclasses.replace(CAMERA, width=5, height=3, common_share=share)
    camera.validate()
    generator, depth = np.random.default_rng(0), np.full((3, 5), 1.2)
    depth[0, 0] = np.inf
    drawn = np.array([noisy_depth(depth, camera, generator) for _ in range(8000)])
    assert np.all(drawn[:, 0, 0] == np.inf)
    whitened = (drawn[:, 1] - 1.2) / (camera.depth_noise * 1.2**2)  # along the middle row
    assert np.mean(whitened[:, 2] ** 2) == pytest.approx(1.0, rel=0.06)
    assert np.mean(whitened[:, 1] * whitened[:, 2]) == pytest.approx(share, abs=0.04)
    assert np.mean(whitened[:, 2]) == pytest.approx(0.0, abs=0.04)


def test_what_differs_counts_by_how_much_and_what_one_of_both_lacks_by_a_centimetre(block: ObjectModel) -> None:
    face = expected_picture(block, X_CO, empty())
    is_seen = np.isfinite(face.depth)
    rows, columns = np.nonzero(is_seen)
    depth = np.where(is_seen, 0.503, np.inf)
    depth[rows[:30], columns[:30]] = 0.45  # something far before it
    depth[rows[30:50], columns[30:50]] = np.inf  # nothing
    depth[0, :40] = 0.9  # something beside it
    hand = np.zeros_like(is_seen)
    hand[rows[50:60], columns[50:60]] = hand[0, :10] = True
    fit = fit_to_picture(DepthPicture(depth, hand, CAMERA), block, X_CO)
    count = len(rows)
    expected = (0.003 * (count - 60) + 0.01 * (30 + 20 + 30)) / (count - 10 + 30)
    assert fit.disagreement == pytest.approx(expected, rel=1e-4)


def test_the_object_is_seen_through_where_what_is_seen_is_beyond_it(block: ObjectModel) -> None:
    face = expected_picture(block, X_CO, empty())
    is_seen = np.isfinite(face.depth)
    rows, columns = (values.reshape(-1) for values in np.nonzero(is_seen))
    inner = (rows > rows.min()) & (rows < rows.max()) & (columns > columns.min()) & (columns < columns.max())
    rows, columns = rows[inner], columns[inner]  # without the rim
    depth = np.where(is_seen, 0.501, np.inf)
    depth[rows[:20], columns[:20]] = 0.47  # hidden
    depth[rows[20:50], columns[20:50]] = 0.56
    depth[rows[50:60], columns[50:60]] = np.inf
    hand = np.zeros_like(is_seen)
    hand[rows[60:70], columns[60:70]] = True
    fit = fit_to_picture(DepthPicture(depth, hand, CAMERA), block, X_CO)
    assert fit.hidden_share == pytest.approx(30 / len(rows))
    assert fit.seen_through == pytest.approx(40 / (len(rows) - 30))
    # Nothing counts as farther by the object's size.
    squares = 0.001**2 * (len(rows) - 70) + 0.06**2 * 30 + block.size**2 * 10
    assert fit.misfit == pytest.approx(np.sqrt(squares / (len(rows) - 30)), rel=1e-4)


def test_where_neither_the_object_nor_anything_is_seen_nothing_agrees(block: ObjectModel) -> None:
    behind = make_poses(np.eye(3), np.array([0.0, 0.0, -0.55]))
    fit = fit_to_picture(empty(), block, behind)
    assert (fit.hidden_share, fit.disagreement) == (1.0, 0.01)


def test_an_image_of_another_size_is_refused() -> None:
    wrong = np.full((40, 61), 0.5)
    with pytest.raises(InvalidInputError, match=r"depth must have the camera's shape, \(40, 60\), not \(40, 61\)"):
        noisy_depth(wrong, CAMERA, np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match="depth must have the camera's shape"):
        take_picture(wrong, *NO_HAND, CAMERA)


def test_an_image_in_millimetres_is_refused() -> None:
    """Also one that a float image holds, as Drake's casts without a word what is written into it."""
    millimetres = np.full((40, 60), 500, dtype=np.uint16)
    millimetres[0, 0] = 0
    for image, reason in (
        (millimetres, r"consist of floats, m, not of whole numbers\. Multiply by 0\.001"),
        (millimetres.astype(np.float32), r"be in metres, but nothing in it is nearer than 500 m\. Multiply by 0\.001"),
    ):
        with pytest.raises(InvalidInputError, match=f"depth must {reason}"):
            take_picture(image, *NO_HAND, CAMERA)
        with pytest.raises(InvalidInputError, match=f"depth must {reason}"):
            noisy_depth(image, CAMERA, np.random.default_rng(0))
    picture = take_picture((0.001 * millimetres).tolist(), *NO_HAND, CAMERA)
    assert picture.depth[0, 0] == np.inf
    np.testing.assert_allclose(picture.depth.ravel()[1:], 0.5)


def test_an_image_in_which_everything_is_too_far_shows_nothing_wrong() -> None:
    """The largest number of 16 bits, which cameras and Drake give there, in metres."""
    too_far = np.full((40, 60), 65535, dtype=np.uint16) * np.float32(0.001)
    picture = take_picture(too_far, *NO_HAND, CAMERA)
    np.testing.assert_allclose(picture.depth, 65.535, rtol=1e-6)
