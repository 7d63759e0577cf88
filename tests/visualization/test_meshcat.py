from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.visualization.appearance import LONGEST_ARROW
from tactopose_drake.visualization.body_meshes import Triangles
from tactopose_drake.visualization.meshcat import aim_camera, draw_scene, upright
from tactopose_drake.visualization.page import save_html
from tactopose_drake.visualization.scene import Scene, ShownHypothesis, arrow_lengths
from tactopose_drake.visualization.touch_marks import add_touch, move_touch
from tests.core.models import brick
from tests.recording_meshcat import RecordingMeshcat

X_PO = RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [0.01, 0.02, 0.1])
n_PC = np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0, 1.0]])
TOUCH = Contacts([[0.03, 0, 0], [-0.03, 0, 0], [0, 0.01, 0.02]], n_PC, n_PC * [[3.0], [1.5], [1e-4]])


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return brick(0.06, 0.08, 0.1)


def shown(contacts: Contacts, count: int = 3) -> RecordingMeshcat:
    meshcat = RecordingMeshcat()
    add_touch(meshcat, "/touch", count, friction=0.5)
    move_touch(meshcat, "/touch", contacts, count)
    return meshcat


def test_normals_and_forces_point_along_their_vectors() -> None:
    meshcat = shown(TOUCH)
    for row in range(2):
        for part in ("normal", "force"):
            X = meshcat.pose(f"/touch/{row}/{part}")
            np.testing.assert_allclose(X.translation(), TOUCH.p_PC[row])
            np.testing.assert_allclose(X.rotation().matrix()[:, 2], n_PC[row], atol=1e-12)


def test_an_arrow_is_as_long_as_its_force_is_large() -> None:
    meshcat = shown(TOUCH)
    np.testing.assert_allclose(arrow_lengths(TOUCH)[:2], [LONGEST_ARROW, LONGEST_ARROW / 2])
    for row in range(2):
        tip = meshcat.pose(f"/touch/{row}/force/head").translation()  # the cone's apex
        np.testing.assert_allclose(tip, TOUCH.p_PC[row] + arrow_lengths(TOUCH)[row] * n_PC[row], atol=1e-12)
        # The shaft is one metre long before it is scaled about its middle.
        length = meshcat.properties[f"/touch/{row}/force/shaft", "scale"][2]
        middle = meshcat.pose(f"/touch/{row}/force/shaft").translation()
        np.testing.assert_allclose(middle - length / 2 * n_PC[row], TOUCH.p_PC[row], atol=1e-12)


def test_a_cross_shines_through_what_hides_it() -> None:
    meshcat = shown(TOUCH)
    for part in ("ball", "bar_0", "bar_1", "bar_2"):
        at = f"/touch/0/false/{part}/through"
        assert at in meshcat.objects
        assert meshcat.properties[f"{at}/<object>", "material.depthTest"] is False


def test_a_force_too_small_for_an_arrow_has_none() -> None:
    meshcat = shown(TOUCH)
    assert meshcat.visible("/touch/1/force")
    assert not meshcat.visible("/touch/2/force")


def test_contacts_without_normals_and_forces_are_points() -> None:
    meshcat = shown(Contacts(TOUCH.p_PC))
    assert meshcat.visible("/touch/0/point")
    assert not meshcat.visible("/touch/0/normal")
    assert not meshcat.visible("/touch/0/force")


def test_contacts_that_end_are_hidden_again() -> None:
    meshcat = shown(TOUCH)
    move_touch(meshcat, "/touch", Contacts.empty(), 3)
    assert not any(meshcat.visible(f"/touch/{row}/point") for row in range(3))


def test_a_scene_is_drawn_with_up_upwards_and_the_camera_on_it(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    up_P = np.array([0.0, -1.0, 0.0])
    scene = Scene(model=model, contacts=TOUCH, hypotheses=(ShownHypothesis(X_PO),), prior=RigidTransform(), up_P=up_P)
    draw_scene(meshcat, scene)
    aim_camera(meshcat, scene, upright(scene))
    np.testing.assert_allclose(meshcat.pose("/tactopose").rotation() @ up_P, [0, 0, 1], atol=1e-12)
    assert set(meshcat.objects) >= {"/tactopose/estimate", "/tactopose/prior", "/tactopose/touch/0/point/ball"}
    assert "/tactopose/truth" not in meshcat.objects
    p_WO = meshcat.pose("/tactopose/estimate").translation()
    assert np.linalg.norm(meshcat.target - p_WO) < 0.1
    assert 0.05 < np.linalg.norm(meshcat.camera - meshcat.target) < 0.5


def test_the_pressed_cells_of_a_scene_are_shown(model: ObjectModel) -> None:
    meshcat = RecordingMeshcat()
    n_PT = np.tile([0.0, 0.0, -1.0], (3, 1))
    patch = describe_patch(0.01 * np.eye(3), [1e4, 0.0, 2e4], alpha=1e-8, n_PT=n_PT)
    draw_scene(meshcat, Scene(model=model, contacts=TOUCH, patches=(patch,)))
    shown = [meshcat.visible(f"/tactopose/patches/0/cells/{cell}") for cell in range(3)]
    assert shown == [True, False, True]


def test_a_scene_of_nothing_but_contacts_is_drawn(model: ObjectModel) -> None:
    meshcat, empty, scene = RecordingMeshcat(), RecordingMeshcat(), Scene(model=model, contacts=TOUCH)
    draw_scene(meshcat, scene)
    drawn = {"/".join(path.split("/")[:4]) for path in meshcat.objects}
    assert drawn == {f"/tactopose/touch/{row}" for row in range(3)}
    for row in range(3):
        assert meshcat.visible(f"/tactopose/touch/{row}/point/ball")
        p_WC = meshcat.pose(f"/tactopose/touch/{row}").translation()
        np.testing.assert_allclose(p_WC, upright(scene) @ TOUCH.p_PC[row], atol=1e-12)
    draw_scene(empty, Scene(model=model, contacts=Contacts.empty()))
    assert not empty.objects


def test_the_page_holds_its_scene_and_needs_no_network(model: ObjectModel, tmp_path: Path) -> None:
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    hand = Triangles(np.eye(3) * 0.05, np.array([[0, 1, 2]], dtype=np.int32), np.full((3, 3), 0.5))
    poses = {"hypotheses": (ShownHypothesis(X_PO),), "prior": X_PO, "truth": X_PO}
    draw_scene(meshcat, Scene(model=model, contacts=TOUCH, hand=hand, friction=0.5, frames=True, **poses))
    for part in (
        "estimate",
        "prior",
        "truth",
        "hand",
        "touch/2/point",
        "touch/2/normal/cone",
        "palm/x",
        "estimate/frame/x",
    ):
        assert meshcat.HasPath(f"/tactopose/{part}")
    save_html(tmp_path / "scene.html", meshcat)
    page = (tmp_path / "scene.html").read_text()
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert 'src="http' not in page
