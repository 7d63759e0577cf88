import math

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.poses import retract
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import flat_pad, touch_with_pads
from tactopose_drake.errors import InvalidInputError, PortTypeError, UnknownNameError
from tactopose_drake.estimation.estimate import estimate_pose
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.systems.pose_estimator import PoseEstimator, PoseEstimatorParams
from tests.systems.pose_estimator_bench import X_PO, Bench, make_box

PRIOR = PosePrior(
    retract(X_PO.GetAsMatrix34(), np.array([0.1, -0.05, 0.08, 0.01, -0.008, 0.006])), 0.02, math.radians(8)
)
# On five sides of the box; two on the largest: the pose is determined.
p_OC = np.array([[0.03, 0.01, 0.0], [-0.03, -0.01, 0.03], [0.0, 0.05, 0.02], [0.01, -0.05, -0.04], [0.01, 0.02, 0.07]])
n_OC = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def touch(count: int = 5) -> Contacts:
    return Contacts(X_PO.multiply(p_OC[:count].T).T, X_PO.rotation().multiply(n_OC[:count].T).T)


def error(pose: RigidTransform) -> tuple[float, float]:
    """Of an estimate against the truth, m and rad."""
    X = X_PO.inverse() @ pose
    return float(np.linalg.norm(X.translation())), X.rotation().ToAngleAxis().angle()


def test_the_touch_corrects_the_prior(box: ObjectModel) -> None:
    bench = Bench(box)
    bench.fix(contacts=touch(), prior=PRIOR)
    pose, hypotheses, status = bench.step()
    before, after = error(PRIOR.X_PO), error(pose)
    assert status == "ok"
    assert pose.IsExactlyEqualTo(hypotheses.best.X_PO)
    assert after[0] < 0.3 * before[0]
    assert after[1] < 0.3 * before[1]


def test_too_few_contacts_hold_the_last_pose_and_say_so(box: ObjectModel) -> None:
    bench = Bench(box)
    bench.fix(contacts=touch(), prior=PRIOR)
    estimated, hypotheses, _ = bench.step()
    elsewhere = PosePrior(RigidTransform([1.0, 1.0, 1.0]))
    for count, said in ((1, "1 touch"), (0, "0 touches")):
        bench.fix(contacts=touch(count), prior=elsewhere)
        pose, still, status = bench.step()
        assert pose.IsExactlyEqualTo(estimated)
        assert [h.cost for h in still.hypotheses] == [h.cost for h in hypotheses.hypotheses]
        assert status == f"held: {said}; 2 are needed"
    bench.fix(contacts=touch(), prior=PRIOR)
    assert bench.step()[2] == "ok"


def test_a_touch_that_no_pose_explains_holds_the_last_pose_and_says_so(box: ObjectModel) -> None:
    bench = Bench(box)
    bench.fix(contacts=touch(), prior=PRIOR)
    estimated = bench.step()[0]
    impossible = Contacts(np.array([[0.0, 0, 0], [0.5, 0, 0]]), np.array([[1.0, 0, 0], [1.0, 0, 0]]))
    bench.fix(contacts=impossible)
    pose, hypotheses, status = bench.step()
    assert pose.IsExactlyEqualTo(estimated)
    assert hypotheses.status == "no_solution"
    assert status == "held: no pose explains the touch"


def test_before_the_first_touch_the_pose_is_the_priors(box: ObjectModel) -> None:
    bench = Bench(box)
    assert bench.read()[1:] == (None, "held: no estimate yet")
    bench.fix(contacts=Contacts.empty(), prior=None)
    assert bench.step()[0].IsExactlyEqualTo(RigidTransform())
    bench.fix(prior=PRIOR)
    pose, hypotheses, _ = bench.step()
    np.testing.assert_array_equal(pose.GetAsMatrix34(), PRIOR.X_PO.GetAsMatrix34())
    assert hypotheses is None


def pads(model: ObjectModel) -> tuple[Patch, ...]:
    """Of four pads that feel the box, and one far away that does not."""
    silent = describe_patch(flat_pad() + np.array([1.0, 0.0, 0.0]), np.zeros(24), alpha=1e-7)
    return *touch_with_pads(model, X_PO.GetAsMatrix34(), 4, np.random.default_rng(0)), silent


@pytest.mark.parametrize("count", [0, 5])
def test_patches_count_like_contacts_and_are_enough_alone(box: ObjectModel, count: int) -> None:
    patches = pads(box)
    bench = Bench(box, min_contacts=count + 4)
    bench.fix(patches=patches, prior=PRIOR, **({"contacts": touch(count)} if count else {}))
    pose, _, status = bench.step()
    assert status in ("ok", "ambiguous")
    by_hand = estimate_pose(box, touch(count), patches=patches, prior=PRIOR, max_hypotheses=16)
    assert pose.IsNearlyEqualTo(by_hand.best.X_PO, 1e-9)
    before, after = error(PRIOR.X_PO), error(pose)
    assert after[0] < before[0]
    assert after[1] < before[1]


def test_pads_that_feel_nothing_are_no_touch(box: ObjectModel) -> None:
    bench = Bench(box, min_contacts=5)
    bench.fix(patches=pads(box), prior=PRIOR)
    assert bench.step()[2] == "held: 4 touches; 5 are needed"


def test_without_contacts_and_patches_the_missing_port_is_named(box: ObjectModel) -> None:
    with pytest.raises(
        PortTypeError, match="input port 'contacts' of system 'estimator' must hold a Contacts, but is not connected"
    ):
        Bench(box).step()


def test_a_prior_that_is_connected_but_not_there_yet_is_waited_for(box: ObjectModel) -> None:
    bench = Bench(box)
    bench.fix(contacts=touch(), prior=None)
    assert bench.step()[2] == "held: no prior yet"


def test_a_local_method_without_a_prior_is_refused(box: ObjectModel) -> None:
    bench = Bench(box, method="levenberg_marquardt")
    bench.fix(contacts=touch())
    with pytest.raises(InvalidInputError, match="prior"):
        bench.step()


def test_an_unknown_method_is_named_with_the_valid_ones(box: ObjectModel) -> None:
    with pytest.raises(UnknownNameError, match=r"method must be one of pair_search.*, not 'guess'"):
        Bench(box, method="guess")


def test_the_same_touch_gives_the_same_pose(box: ObjectModel) -> None:
    poses = []
    for _ in range(2):
        bench = Bench(box)
        bench.fix(contacts=touch(), prior=PRIOR)
        poses.append(bench.step()[0])
    assert poses[0].IsExactlyEqualTo(poses[1])


def test_another_seed_gives_another_search(box: ObjectModel) -> None:
    """Seen in how the time limit cuts it: with so little time the random start of a Monte Carlo search decides."""
    poses = {}
    for seed in (1, 1, 2):
        bench = Bench(box, method="monte_carlo", seed=seed, max_duration=1e-9)
        bench.fix(contacts=touch(3), prior=PRIOR)
        pose = bench.step()[0]
        assert pose.IsExactlyEqualTo(poses.setdefault(seed, pose))
    assert not poses[1].IsExactlyEqualTo(poses[2])


def test_an_estimate_that_is_cut_short_says_so(box: ObjectModel) -> None:
    bench = Bench(box, max_duration=1e-9)
    bench.fix(contacts=touch(), prior=PRIOR)
    _, hypotheses, status = bench.step()
    assert not hypotheses.finished
    assert status in ("ok: the search was cut short", "ambiguous: the search was cut short")


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3])
def test_how_often_contacts_are_of_something_else_reaches_the_estimate(box: ObjectModel, share: float) -> None:
    bench = Bench(box, outlier_probability=share)
    bench.fix(contacts=touch(), prior=PRIOR)
    expected = estimate_pose(box, touch(), prior=PRIOR, max_hypotheses=16, outlier_probability=share)
    np.testing.assert_array_equal(bench.step()[1].best.inlier_probability, expected.best.inlier_probability)


@pytest.mark.parametrize("turn", [(0.3, 0.9, -0.5), (1.3, -0.4, 2.0), (-2.0, 0.3, 0.1), (2.5, 0.7, -1.0)])
def test_the_pose_turns_with_the_touch(box: ObjectModel, turn: tuple[float, float, float]) -> None:
    """The same touch, seen from a palm that is elsewhere, gives the same pose, seen from there."""
    X_QP = RigidTransform(RollPitchYaw(*turn), [0.2, 0.1, -0.3])
    bench = Bench(box)
    bench.fix(contacts=touch(), prior=PRIOR)
    pose = bench.step()[0]
    contacts = touch()
    moved = Contacts(X_QP.multiply(contacts.p_PC.T).T, X_QP.rotation().multiply(contacts.n_PC.T).T)
    bench = Bench(box)
    bench.fix(contacts=moved, prior=PosePrior(X_QP @ PRIOR.X_PO, 0.02, math.radians(8)))
    assert (X_QP @ pose).IsNearlyEqualTo(bench.step()[0], 1e-4)


def test_a_table_says_how_far_the_object_has_slid(box: ObjectModel) -> None:
    sides = Contacts(X_PO.multiply(p_OC[:4].T).T, X_PO.rotation().multiply(n_OC[:4].T).T)
    assert not n_OC[:4, 2].any()
    slid = X_PO @ RigidTransform([0.0, 0.0, 0.015])
    table = PlaneContact(X_PO.multiply([0.0, 0.0, -0.07]), X_PO.rotation().multiply([0.0, 0.0, 1.0]))
    off = {}
    for planes in ((), (table,)):
        bench = Bench(box)
        bench.fix(contacts=sides, prior=PosePrior(slid, 0.02, 0.15), planes=planes)
        off[planes] = abs((X_PO.inverse() @ bench.step()[0]).translation()[2])
    # The sides tell nothing of it but that they are touched: what is left of the prior has its mean at 7.5 mm.
    assert off[()] > 0.005
    assert off[table,] < 0.002


@pytest.mark.parametrize(
    "inputs",
    [
        {"contacts": {"not": 1}},
        {"contacts": Contacts.empty(), "prior": {"not": 1}},
        {"contacts": touch(), "patches": {"not": 1}},
        {"contacts": touch(), "hand": {"not": 1}},
        {"contacts": touch(), "untouched": {"not": 1}},
        {"contacts": touch(), "planes": {"not": 1}},
    ],
)
def test_a_value_of_another_type_is_refused_by_the_name_of_the_port(
    box: ObjectModel, inputs: dict[str, object]
) -> None:
    bench = Bench(box)
    bench.fix(**inputs)
    with pytest.raises(
        PortTypeError, match=f"input port '{list(inputs)[-1]}' of system 'estimator' must hold an? \\w+, not a dict"
    ):
        bench.step()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("patches", ("x",), "must hold a tuple of Patch, not one with a str"),
        ("planes", (3,), "must hold a tuple of PlaneContact, not one with an int"),
        ("planes", [], "must hold a tuple, not a list"),
    ],
)
def test_items_of_another_type_are_refused_before_anything_is_touched(
    box: ObjectModel, name: str, value: object, message: str
) -> None:
    bench = Bench(box)
    bench.fix(contacts=Contacts.empty(), **{name: value})
    with pytest.raises(PortTypeError, match=f"input port '{name}' of system 'estimator' {message}"):
        bench.step()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("period", 0.0),
        ("min_contacts", 0),
        ("min_contacts", 2.5),
        ("max_hypotheses", 0),
        ("seed", -1),
        ("max_duration", 0.0),
        ("collision_tolerance", -1.0),
        ("outlier_probability", 1.5),
    ],
)
def test_a_bad_parameter_is_named(name: str, value: float) -> None:
    with pytest.raises(InvalidInputError, match=f"{name} must be .*, not {value:g}"):
        PoseEstimatorParams(**{name: value}).validate()


def test_an_object_or_parameters_of_another_type_are_named(box: ObjectModel) -> None:
    with pytest.raises(InvalidInputError, match=r"^model must be an ObjectModel, not an int"):
        PoseEstimator(3)
    with pytest.raises(InvalidInputError, match=r"^params must be a PoseEstimatorParams, not an int"):
        PoseEstimator(box, 3)
