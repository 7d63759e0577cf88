import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.cli.demo_reports import pad_force, report_finger, report_pad, report_pose
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.runs.contact_truth import PartContact
from tests.core.models import brick

AREAS = np.full(4, 2e-5)
CORNERS = np.array([[x, y, 0.0] for x in (-0.005, 0.005) for y in (-0.004, 0.004)])


def patch(*pressure: float) -> Patch:
    """A flat pad of four cells that looks along z."""
    return describe_patch(CORNERS, pressure, alpha=1e-8, n_PT=np.tile([0.0, 0.0, 1.0], (4, 1)), threshold=100.0)


def truth(p_PC: tuple[float, float, float]) -> PartContact:
    """The object is above the pad, its normal down, and it pushes the pad down and aside."""
    return PartContact(np.array(p_PC), np.array([0.0, 0.0, -1.0]), np.array([0.3, 0.0, -2.0]), 1e-4)


def test_the_object_pushes_into_the_pad_and_a_dead_cell_counts_for_nothing() -> None:
    np.testing.assert_allclose(pad_force(patch(1e4, 2e4, 0.0, 1e4), AREAS), [0.0, 0.0, -0.8])
    np.testing.assert_allclose(pad_force(patch(1e4, np.nan, 0.0, 1e4), AREAS), [0.0, 0.0, -0.4])


def test_a_pad_is_compared_with_the_simulators_contact() -> None:
    report = report_pad("palm", patch(1e4, 1e4, 1e4, 1e4), AREAS, truth((0.001, 0.0, -1e-4)))
    assert (report.pad, report.status, report.active_cells) == ("palm", "area", 4)
    assert report.force == pytest.approx(0.8)
    assert report.true_force == pytest.approx(2.0)  # The normal part alone.
    assert report.centroid_error == pytest.approx(0.001)
    assert report.normal_error == pytest.approx(0.0, abs=1e-6)


def test_what_is_not_known_of_a_pad_is_left_out() -> None:
    silent = report_pad("palm", patch(0.0, 0.0, 0.0, 0.0), AREAS, truth((0.0, 0.0, 0.0)))
    assert (silent.active_cells, silent.centroid_error, silent.normal_error) == (0, None, None)
    unsupported = report_pad("palm", patch(1e4, 1e4, 1e4, 1e4), AREAS, None)
    assert (unsupported.true_force, unsupported.centroid_error, unsupported.normal_error) == (0.0, None, None)
    row = report_pad("palm", patch(1e4, 1e4, 0.0, 0.0), AREAS, truth((-0.005, 0.0, -1e-4)))
    assert row.status == "row"
    assert row.centroid_error == pytest.approx(0.0, abs=1e-9)
    assert row.normal_error is None


def test_a_finger_is_compared_with_the_simulators_contact() -> None:
    contacts = Contacts([[0.0, 0.003, 0.0]], [[0.0, 0.0, -1.0]], [[0.0, 3.0, -4.0]])
    report = report_finger("thumb", 0, contacts, truth((0.0, 0.0, 0.0)))
    assert report.force == pytest.approx(5.0)
    assert report.position_error == pytest.approx(0.003)
    assert report.normal_error == pytest.approx(0.0, abs=1e-6)
    assert report_finger("thumb", 0, contacts, None).position_error is None


def test_a_pose_is_compared_with_the_truth_where_the_touch_determines_it() -> None:
    model = brick(0.06, 0.08, 0.1)
    X_true = RigidTransform(RollPitchYaw(0.3, -0.2, 0.5), [0.01, 0.02, 0.1])
    n_O = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    p_PC = X_true.multiply((n_O * [0.03, 0.04, 0.05]).T).T
    touch = Contacts(p_PC, n_O @ X_true.rotation().matrix().T)
    exact = report_pose("touch", X_true.GetAsMatrix34(), X_true, model, touch, np.zeros((0, 6)))
    for name in ("translation", "rotation", "MDTS", "MATN", "RME", "MAE"):
        assert getattr(exact, name) == pytest.approx(0.0, abs=2e-4), name
    shifted = RigidTransform(X_true.rotation(), np.add(X_true.translation(), [0.003, 0.004, 0.0]))
    free = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    report = report_pose("vision", shifted.GetAsMatrix34(), X_true, model, touch, free)
    assert report.translation == pytest.approx(0.005)
    assert report.determined_translation == pytest.approx(0.004)
    np.testing.assert_allclose(report.RME, 0.005)
    assert report.rotation == pytest.approx(0.0, abs=1e-9)
