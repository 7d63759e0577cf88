import dataclasses

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization.appearance import CONE, FORCE, LONGEST_ARROW, NORMAL
from tactopose_drake.visualization.estimate_page import instant_of, page_of
from tactopose_drake.visualization.picture_marks import certainty_surface
from tactopose_drake.visualization.scene import Scene, ShownHypothesis, arrow_lengths, false_contacts, touch_of
from tactopose_drake.visualization.touch_marks import CONE_LENGTH, add_touch, move_touch
from tests.recording_meshcat import RecordingMeshcat


def pad(pressure: float) -> Patch:
    cells = flat_pad()
    return describe_patch(
        cells, np.full(len(cells), pressure), alpha=1e-7, n_PT=np.tile([0.0, 0.0, 1.0], (len(cells), 1))
    )


def test_the_patch_that_is_false_is_the_one_that_is_drawn_so() -> None:
    contacts = Contacts([[0.0, 0.0, 0.1], [0.0, 0.1, 0.0]], [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    silent, felt = pad(0.0), pad(1e4)
    patches = (silent, felt, silent, felt)
    best = ShownHypothesis(RigidTransform(), inlier_probability=np.array([0.9, 0.1, 1.0, 0.8, 1.0, 0.2]))
    touch = touch_of(contacts, patches)
    assert len(touch) == 4
    np.testing.assert_array_equal(false_contacts((best,), 4, patches), [False, True, False, True])
    # Contacts alone are the first ones; a hypothesis of fewer of them, or none, says nothing.
    np.testing.assert_array_equal(false_contacts((best,), 2), [False, True])
    fewer = dataclasses.replace(best, inlier_probability=np.array([0.1]))
    assert not false_contacts((fewer,), 4, patches).any()
    assert not false_contacts((), 4, patches).any()


def test_the_table_of_contacts_gives_each_pad_its_own_probability(blob: ObjectModel) -> None:
    patches = (pad(0.0), pad(1e4), pad(0.0), pad(1e4))
    best = ShownHypothesis(RigidTransform(), inlier_probability=np.array([0.9, 1.0, 0.8, 1.0, 0.2]))
    touch = touch_of(Contacts([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]]), patches)
    scene = Scene(model=blob, contacts=touch, patches=patches, hypotheses=(best,))
    table = instant_of(scene, None).contacts
    column = table.headings.index("of object")
    assert [row.cells[column] for row in table.rows] == ["90%", "80%", "20%"]


def test_the_longest_arrow_is_as_long_as_the_legend_says_beside_a_larger_force_that_is_false(blob: ObjectModel) -> None:
    contacts = Contacts(0.1 * np.eye(3), np.eye(3), np.diag([8.0, 1.0, 2.0]))
    best = ShownHypothesis(RigidTransform(), inlier_probability=np.array([0.1, 0.9, 0.9]))
    scene = Scene(model=blob, contacts=contacts, hypotheses=(best,))
    np.testing.assert_allclose(arrow_lengths(contacts, scene.is_false), [0.0, 0.5 * LONGEST_ARROW, LONGEST_ARROW])
    told = PoseHypothesis(RigidTransform(), 0.0, 1.0, np.eye(6), np.zeros((0, 6)))
    page = page_of(scene, PoseEstimate((told,), "ok", 0.0))
    assert next(switch.detail for switch in page.switches if switch.look is FORCE).endswith("the longest is 2.0 N")
    meshcat = RecordingMeshcat()
    add_touch(meshcat, "/touch", 3)  # type: ignore[arg-type]
    move_touch(meshcat, "/touch", contacts, 3, is_false=scene.is_false)  # type: ignore[arg-type]
    tips = [meshcat.transforms[f"/touch/{row}/force/head"].translation()[2] for row in (1, 2)]
    np.testing.assert_allclose(tips, [0.5 * LONGEST_ARROW, LONGEST_ARROW])
    assert [meshcat.visible(f"/touch/{row}/force") for row in range(3)] == [False, True, True]
    # Where all are false, no arrow is drawn or explained.
    none = dataclasses.replace(best, inlier_probability=np.full(3, 0.1))
    assert FORCE not in dataclasses.replace(scene, hypotheses=(none,)).looks


def test_a_contact_without_a_normal_is_drawn_without_one_beside_a_pad_that_has_one(blob: ObjectModel) -> None:
    patches = (pad(1e4),)
    touch = touch_of(Contacts([[0.0, 0.0, 0.1], [0.0, 0.1, 0.0]]), patches)
    meshcat = RecordingMeshcat()
    add_touch(meshcat, "/touch", 3, friction=0.5)  # type: ignore[arg-type]
    move_touch(meshcat, "/touch", touch, 3)  # type: ignore[arg-type]
    assert [meshcat.visible(f"/touch/{row}/normal/line") for row in range(3)] == [False, False, True]
    assert [meshcat.visible(f"/touch/{row}/point/ball") for row in range(3)] == [True, True, True]
    best = (ShownHypothesis(RigidTransform()),)
    scene = Scene(model=blob, contacts=touch, patches=patches, hypotheses=best, friction=0.5)
    assert {NORMAL, CONE} <= set(scene.looks)
    bare = Scene(model=blob, contacts=touch[:2], hypotheses=best, friction=0.5)
    assert not {NORMAL, CONE} & set(bare.looks)
    assert certainty_surface(bare) is None
    drawn = certainty_surface(scene)
    assert drawn is not None
    assert np.linalg.norm(drawn.vertices - touch.p_PC[2], axis=1).max() < 0.025  # of the pad's cone alone


def test_a_friction_cone_stands_on_its_contact_and_opens_along_the_normal(blob: ObjectModel) -> None:
    n_PC, friction = np.array([0.0, 0.6, -0.8]), 0.5
    contacts = Contacts([[0.01, 0.02, 0.1]], [n_PC])
    scene = Scene(model=blob, contacts=contacts, hypotheses=(ShownHypothesis(RigidTransform()),), friction=friction)
    cone = certainty_surface(scene)
    assert cone is not None
    offset = cone.vertices - contacts.p_PC[0]
    height = offset @ n_PC
    across = np.linalg.norm(offset - np.outer(height, n_PC), axis=1)
    assert (height.min(), height.max()) == pytest.approx((0.0, CONE_LENGTH), abs=1e-9)
    assert across.max() == pytest.approx(friction * CONE_LENGTH)
    assert np.all(across <= friction * height + 1e-9)


def test_a_pad_has_no_force_in_the_table_of_contacts(blob: ObjectModel) -> None:
    contacts = Contacts([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]], [[0.0, 0.0, -2.0]])
    patches = (pad(0.0), pad(1e4))
    scene = Scene(model=blob, contacts=touch_of(contacts, patches), patches=patches, touched_by=("thumb", "palm"))
    table = instant_of(scene, None).contacts
    force = table.headings.index("force, N")
    assert [(row.cells[0], row.cells[force]) for row in table.rows] == [("1 thumb", "2.00"), ("2 palm", "")]
