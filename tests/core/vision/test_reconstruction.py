"""Meshes of objects that are known from depth images only."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.vision.depth_fusion import FusionParams
from tactopose_drake.core.vision.depth_view import DepthView
from tactopose_drake.core.vision.reconstruction import Reconstruction, _is_seen, reconstruct
from tactopose_drake.errors import InvalidInputError
from tests.core.models import brick
from tests.core.vision.seen_scenes import VIEW_CAMERA, views_of


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return brick(0.06, 0.08, 0.1)


def test_the_surface_is_off_by_the_mean_square_over_what_is_seen_and_what_is_not() -> None:
    nothing = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32), np.zeros(0, dtype=np.bool_)
    found = Reconstruction(*nothing, seen_sigma=0.001, unseen_sigma=0.007, unseen_share=0.25)
    assert found.surface_sigma == pytest.approx(math.sqrt(0.75 * 0.001**2 + 0.25 * 0.007**2))


TABLE = np.array([[-np.inf, -np.inf, -0.05], [np.inf] * 3])


@pytest.fixture(scope="module")
def around(box: ObjectModel) -> Reconstruction:
    return reconstruct(views_of(box, 120.0), TABLE)


def test_what_was_seen_lies_on_the_object(box: ObjectModel, around: Reconstruction) -> None:
    mesh = trimesh.Trimesh(around.vertices, around.faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(box.volume, rel=0.12)
    distance = box.grid.distance(around.vertices)
    assert np.sqrt(np.mean(distance[around.seen] ** 2)) < 1.5 * around.seen_sigma
    assert around.seen_sigma < 0.0015


def test_the_order_of_cameras_that_differ_tells_nothing(box: ObjectModel) -> None:
    """One whose errors are all alike, and two whose errors average out: what is common to an image is its camera's."""
    shares = (1.0, 0.0, 0.0)
    seen = [
        dataclasses.replace(view, camera=dataclasses.replace(VIEW_CAMERA, common_share=share))
        for view, share in zip(views_of(box, 120.0), shares, strict=True)
    ]
    first, last = (reconstruct(ordered, TABLE).seen_sigma for ordered in (seen, seen[::-1]))
    assert first == pytest.approx(last, rel=1e-6)
    alike = [dataclasses.replace(view, camera=dataclasses.replace(VIEW_CAMERA, common_share=1.0)) for view in seen]
    assert first < reconstruct(alike, TABLE).seen_sigma


def test_what_an_image_s_errors_have_in_common_adds_to_those_of_its_points(box: ObjectModel) -> None:
    seen = views_of(box, 120.0)
    sigmas = []
    for share in (0.0, 0.8):
        camera = dataclasses.replace(VIEW_CAMERA, common_share=share)
        sigmas.append(reconstruct([dataclasses.replace(view, camera=camera) for view in seen], TABLE).seen_sigma)
    noise = np.mean([VIEW_CAMERA.depth_noise * np.median(view.depth[np.isfinite(view.depth)]) ** 2 for view in seen])
    assert sigmas[1] ** 2 - sigmas[0] ** 2 == pytest.approx(0.8 * noise**2)


def test_a_surface_is_seen_within_half_of_the_truncation(box: ObjectModel) -> None:
    seen, params = views_of(box, 120.0), FusionParams()
    points = seen[0].p_OQ[::50]
    ray = points + seen[0].X_CO[:, :3].T @ seen[0].X_CO[:, 3]
    for share, is_seen in ((0.4, True), (-0.4, True), (0.6, False), (-0.6, False)):
        shifted = points + share * params.truncation * ray / (ray @ seen[0].X_CO[2, :3])[:, None]
        found = np.isfinite(seen[0].depth_behind(shifted))
        assert np.all(_is_seen(shifted[found], seen[:1], params) == is_seen)


def test_the_unseen_part_is_said(box: ObjectModel, around: Reconstruction) -> None:
    # The bottom's share of the surface, and a part of the sides near it.
    assert 0.5 * 48.0 / 376.0 < around.unseen_share < 3.0 * 48.0 / 376.0
    assert around.vertices[~around.seen, 2].mean() < -0.035
    one_side = reconstruct(views_of(box, 40.0), TABLE)
    assert one_side.unseen_share > 2.0 * around.unseen_share
    assert one_side.unseen_sigma > 1.5 * one_side.seen_sigma
    assert one_side.surface_sigma > around.surface_sigma
    # A back that nobody has seen is too large, never too small.
    assert box.grid.distance(one_side.vertices[~one_side.seen]).mean() > 0.002


def test_what_cannot_be_fused_is_refused(box: ObjectModel) -> None:
    seen = views_of(box, 120.0)
    with pytest.raises(InvalidInputError, match="views must be at least 2, not 1"):
        reconstruct(seen[:1])
    nothing = [DepthView(np.full_like(view.depth, np.inf), view.X_CO, view.camera) for view in seen]
    with pytest.raises(InvalidInputError, match=r"views must see at least .* points, not 0"):
        reconstruct(nothing)
    with pytest.raises(InvalidInputError, match=r"FusionParams\.spacing must be larger than"):
        reconstruct(seen, params=FusionParams(spacing=1e-5))


def test_what_lies_outside_of_all_images_is_not_taken_for_the_object() -> None:
    """An object that reaches near the images' upper end: the space above, which no image shows, is larger."""
    tall = trimesh.creation.box((0.06, 0.07, 0.14), trimesh.transformations.translation_matrix([0.0, 0.0, 0.07]))
    model = ObjectModel.from_mesh(tall, cache=False)
    found = reconstruct(views_of(model, 120.0), np.array([[-np.inf, -np.inf, 0.0], [np.inf] * 3]))
    assert found.unseen_share < 0.4
    assert np.sqrt(np.mean(model.grid.distance(found.vertices[found.seen]) ** 2)) < 1.5 * found.seen_sigma


def test_an_image_beside_the_object_says_nothing_of_it(box: ObjectModel) -> None:
    seen = views_of(box, 120.0)
    aside = np.column_stack([seen[0].X_CO[:, :3], seen[0].X_CO[:, 3] + [5.0, 0.0, 0.0]])
    beside = DepthView(np.full_like(seen[0].depth, np.inf), aside, seen[0].camera)
    with_it, without = reconstruct([*seen, beside], TABLE), reconstruct(seen, TABLE)
    np.testing.assert_array_equal(with_it.vertices, without.vertices)
    assert with_it.seen_sigma == without.seen_sigma


@pytest.mark.parametrize(
    "bounds",
    [[[0.2] * 3, [0.5] * 3], [[1.0] * 3, [-1.0] * 3], [[np.nan] * 3, [1.0] * 3], [[-1.0] * 2, [1.0] * 2]],
)
def test_bounds_that_leave_nothing_are_refused(box: ObjectModel, bounds: list[list[float]]) -> None:
    with pytest.raises(InvalidInputError, match="bounds must "):
        reconstruct(views_of(box, 120.0), np.array(bounds))
