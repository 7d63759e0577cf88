"""Results and evidence by hand: short representations, tables, indices, equality, and plain data and back."""

import copy
import dataclasses
import json
import math
import pickle

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

import tactopose_drake as tp
from tactopose_drake.core.evidence import Contacts as CoreContacts
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.tracking import PoseTracker
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand import HandGeometry
from tactopose_drake.resources import model_path


def contacts(seed: int, count: int = 4) -> tp.Contacts:
    generator = np.random.default_rng(seed)
    n_PC = generator.normal(size=(count, 3))
    n_PC /= np.linalg.norm(n_PC, axis=1, keepdims=True)
    return tp.Contacts(0.1 * generator.normal(size=(count, 3)), n_PC, generator.normal(size=(count, 3)))


def prior(seed: int) -> tp.PosePrior:
    generator = np.random.default_rng(seed)
    return tp.PosePrior(make_poses(random_rotations(generator, 1)[0], generator.normal(size=3)), 0.02, 0.3)


def estimate(seed: int, count: int = 3) -> tp.PoseEstimate:
    generator = np.random.default_rng(seed)
    hypotheses = []
    for share in np.linspace(3.0, 1.0, count):
        root = 0.01 * generator.normal(size=(6, 6))
        X_PO = RigidTransform(RotationMatrix(random_rotations(generator, 1)[0]), generator.normal(size=3))
        rows = np.eye(6)[: generator.integers(0, 2)]
        hypotheses.append(tp.PoseHypothesis(X_PO, generator.normal(), share / (2.0 * count), root @ root.T, rows))
    return tp.PoseEstimate(tuple(hypotheses), "ambiguous", 0.0064)


def identification() -> tp.Identification:
    return tp.Identification((tp.Identity("mug", 0, 1, 1.0, 0.9, -3.0, estimate(0)),), "ok", 0.01, 0.1)


def hand(seed: int) -> HandGeometry:
    count = seed % 3 + 1
    return HandGeometry(np.full((count, 3), 1e-4 * seed), np.full(count, 0.01))


def best(seed: int) -> tp.PoseHypothesis:
    return estimate(seed).best


MAKERS = [contacts, prior, estimate, best, hand]


@pytest.mark.parametrize("make", MAKERS)
@hypothesis.given(seed=st.integers(0, 10_000))
@hypothesis.settings(max_examples=20)
def test_what_becomes_plain_data_comes_back_to_the_last_bit(make, seed: int) -> None:
    value = make(seed)
    again = type(value).from_dict(json.loads(json.dumps(value.to_dict(), allow_nan=False)))
    assert type(again) is type(value)
    assert again == value
    assert hash(again) == hash(value)
    assert json.dumps(again.to_dict()) == json.dumps(value.to_dict())


@pytest.mark.parametrize("make", MAKERS)
def test_values_are_equal_by_what_is_in_them(make) -> None:
    one, other = make(1), make(2)
    assert one == make(1)
    assert one != other
    assert one == copy.deepcopy(one)
    assert one == pickle.loads(pickle.dumps(one))
    assert len({one, make(1), other}) == 2
    assert one != "something else"
    assert one is not None


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("again", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies_are_read_only_as_what_they_are_of(make, again) -> None:
    value = again(make(1))
    for part in getattr(value, "hypotheses", (value,)):
        arrays = [array for array in vars(part).values() if isinstance(array, np.ndarray)]
        assert arrays
        assert not any(array.flags.writeable for array in arrays)


def test_a_difference_in_any_field_is_one() -> None:
    one = estimate(0).best
    for name, value in (
        ("probability", 0.1),
        ("explains_touch", False),
        ("covariance", np.eye(6)),
        ("X_PO", RigidTransform()),
        ("free_directions", np.eye(6)[:3]),
    ):
        fields = {key: getattr(one, key) for key in ("X_PO", "cost", "probability", "covariance", "free_directions")}
        assert tp.PoseHypothesis(**{**fields, "explains_touch": True}) == one
        assert tp.PoseHypothesis(**{**fields, name: value}) != one
    touch = contacts(0)
    assert tp.Contacts(touch.p_PC, touch.n_PC) != touch
    assert tp.Contacts(touch.p_PC, touch.n_PC, touch.f_PC, sigma_normal=0.1) != touch


def test_core_and_public_contacts_are_one_kind() -> None:
    touch = contacts(0)
    core = CoreContacts(touch.p_PC, touch.n_PC, touch.f_PC)
    assert core == touch
    assert touch == core
    assert isinstance(touch, CoreContacts)


@pytest.mark.parametrize(
    ("cls", "data", "message"),
    [
        (tp.Contacts, {"p_PC": [[0, 0, 0]], "normal": []}, "must be one of p_PC, n_PC.*, not 'normal'"),
        (tp.Contacts, {}, "missing"),
        (tp.Contacts, {"p_PC": [[0, 0]]}, "p_PC must have the shape .*"),
        (tp.PosePrior, {"X_PO": np.ones((3, 4)).tolist()}, "X_PO must have a rotation matrix as its left 3x3 block"),
        (
            tp.PoseEstimate,
            {"status": "ok", "duration": 0.0, "hypotheses": []},
            "hypotheses must be at least one, not none",
        ),
        (tp.PoseHypothesis, {"X_PO": np.eye(3, 4).tolist()}, "missing"),
    ],
)
def test_plain_data_that_is_no_value_is_refused(cls, data: dict, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        cls.from_dict(data)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"covariance": "abc"}, "covariance must consist of numbers"),
        ({"covariance": [[1.0], [1.0, 2.0]]}, "covariance must consist of numbers"),
        ({"covariance": np.eye(5).tolist()}, r"covariance must have the shape \(6, 6\), not \(5, 5\)"),
        ({"covariance": np.full((6, 6), np.nan)}, r"covariance\[0, 0\] must be .*, not nan"),
        ({"covariance": (-np.eye(6)).tolist()}, "covariance must have variances >= 0, not -1"),
        (
            {"covariance": np.triu(np.ones((6, 6))).tolist()},
            "covariance must be symmetric, not of correlations that differ by 1",
        ),
        (
            {"covariance": (1e-300 * np.eye(6) + 1e10 * np.eye(6)[::-1]).tolist()},
            "covariance must be positive semidefinite",
        ),
        (
            {"covariance": (1e-8 * (3.0 * np.ones((6, 6)) - 2.0 * np.eye(6))).tolist()},
            "covariance must be positive semidefinite, but some combination of errors has a variance below 0",
        ),
        ({"free_directions": [[1.0, 2.0]]}, r"free_directions must have the shape .*, not \(1, 2\)"),
        ({"free_directions": None}, "free_directions must consist of numbers, not None"),
        ({"inlier_probability": "x"}, "inlier_probability must consist of numbers, not 'x'"),
        ({"inlier_probability": [0.5, 2.0]}, r"inlier_probability\[1\] must be a number from 0 to 1, not 2"),
        ({"probability": -3}, "probability must be a number >= 0, not -3"),
        ({"probability": None}, "probability must be a number, not None"),
        ({"cost": "a"}, "cost must be a number, not 'a'"),
        ({"explains_touch": "yes"}, "explains_touch must be True or False, not 'yes'"),
        ({"X_PO": "here"}, "X_PO must consist of numbers, not 'here'"),
    ],
)
def test_a_hypothesis_of_plain_data_has_values_that_can_be(change: dict, message: str) -> None:
    data = estimate(0).to_dict()
    with pytest.raises(InvalidInputError, match=f"^{message}"):
        tp.PoseHypothesis.from_dict({**data["hypotheses"][1], **change})
    data["hypotheses"][1].update(change)
    with pytest.raises(InvalidInputError, match=rf"^hypotheses\[1\]: {message}"):
        tp.PoseEstimate.from_dict(data)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hypotheses": 5}, "hypotheses must be a list of at least one, not 5"),
        ({"hypotheses": [5]}, r"hypotheses\[0\]: PoseHypothesis.from_dict must be a Mapping, not an int"),
        ({"status": "x"}, "status must be one of ok, ambiguous, no_solution.*, not 'x'"),
        ({"duration": "a"}, "duration must be a number, not 'a'"),
        ({"duration": -1.0}, "duration must be .*, not -1"),
        ({"log_evidence": "a"}, "log_evidence must be a number, not 'a'"),
        ({"standard_error": math.nan}, "standard_error must be .*, not nan"),
        ({"standard_error": -0.1}, "standard_error must be a number >= 0, not -0.1"),
        ({"kept_share": 2.0}, "kept_share must be a number from 0 to 1, not 2"),
        ({"finished": None}, "finished must be True or False, not None"),
    ],
)
def test_an_estimate_of_plain_data_has_values_that_can_be(change: dict, message: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^{message}"):
        tp.PoseEstimate.from_dict({**estimate(0).to_dict(), **change})


def test_hypotheses_of_plain_data_are_of_one_touch() -> None:
    data = estimate(0).to_dict()
    first, *others = data["hypotheses"]
    with pytest.raises(InvalidInputError, match=r"^hypotheses must have probabilities that sum to 1, not 0.5"):
        tp.PoseEstimate.from_dict({**data, "hypotheses": [first]})
    others[1]["inlier_probability"] = [0.5]
    with pytest.raises(
        InvalidInputError, match=r"^hypotheses\[2\]\.inlier_probability must have the length .* 0, not 1"
    ):
        tp.PoseEstimate.from_dict(data)


def test_plain_data_of_few_digits_is_an_estimate_still() -> None:
    data = estimate(3).to_dict()
    for each in data["hypotheses"]:
        each["probability"] = round(each["probability"], 4)
        each["covariance"] = [[float(f"{x:.6g}") for x in row] for row in each["covariance"]]
    assert len(tp.PoseEstimate.from_dict(data)) == 3


def test_a_probability_that_rounding_has_raised_above_one_is_one() -> None:
    data = {**estimate(0).best.to_dict(), "probability": 1.0000000000000002}
    assert tp.PoseHypothesis.from_dict(data).probability == 1.0


@pytest.mark.parametrize("cls", [tp.PoseEstimate, tp.PoseHypothesis, tp.Contacts, tp.PosePrior, tp.Identification])
@pytest.mark.parametrize("data", [None, 5, [1.0], "ok"])
def test_what_is_no_mapping_is_no_value(cls, data: object) -> None:
    with pytest.raises(InvalidInputError, match=rf"^{cls.__name__}.from_dict must be a Mapping, not (an? \w+|None)"):
        cls.from_dict(data)


def test_a_touch_that_is_surely_false_is_in_plain_data_too() -> None:
    sure = dataclasses.replace(best(0), inlier_probability=np.array([0.0, 1.0]), covariance=np.zeros((6, 6)))
    assert tp.PoseHypothesis.from_dict(json.loads(json.dumps(sure.to_dict()))) == sure


def test_no_evidence_at_all_is_null_in_plain_data() -> None:
    assert estimate(0).log_evidence == -math.inf
    assert tp.PoseEstimate.from_dict({**estimate(0).to_dict(), "log_evidence": -math.inf}) == estimate(0)
    assert estimate(0).to_dict()["log_evidence"] is None
    assert tp.PoseEstimate.from_dict(estimate(0).to_dict()).log_evidence == -math.inf


def test_what_an_estimate_gives_out_cannot_be_written() -> None:
    made = estimate(0)
    best, modes = made.best, made.modes
    for array in (best.covariance, best.free_directions, best.inlier_probability, modes.X_PO, modes.covariance):
        assert not array.flags.writeable
    own = np.eye(6)
    kept = dataclasses.replace(best, covariance=own)
    own[0, 0] = 2.0  # Whose array it is may write it.
    assert not kept.covariance.flags.writeable


def test_hypotheses_are_counted_indexed_and_walked_through() -> None:
    made = estimate(0, count=5)
    assert len(made) == 5
    assert made[0] is made.best
    assert made[-1] is made.hypotheses[-1]
    assert made[1:3] == made.hypotheses[1:3]
    assert list(made) == list(made.hypotheses)
    assert made.best in made
    with pytest.raises(IndexError):
        made[5]


def test_a_table_says_its_units_and_what_it_leaves_out() -> None:
    covariance = np.diag([1e-4] * 3 + [4e-6] * 3)
    hypotheses = (
        tp.PoseHypothesis(RigidTransform([0.0123, -0.02, 0.1]), 2.5, 0.75, covariance, np.eye(6)[:1]),
        tp.PoseHypothesis(RigidTransform(), 3.5, 0.25, np.eye(6), np.zeros((0, 6))),
    )
    made = tp.PoseEstimate(hypotheses, "ok", 0.01)
    first, head, best, other = made.table().splitlines()
    assert first == "status: ok"
    assert head.split("  ")[-1] == "cost"
    assert "p_PO, mm" in head
    assert "± mm, all directions" in head
    assert " ".join(best.split()) == "75.0% [12.3, -20.0, 100.0] [1.000, 0.000, 0.000, 0.000] 3.5 1.0 1 2.50"
    assert other.split()[0] == "25.0%"
    assert len(best) == len(head)
    assert made.table(most=1).splitlines()[-1] == "and 1 less probable"
    assert made.table(most=2) == made.table()


def test_representations_are_short_and_say_what_matters() -> None:
    model = tp.ObjectModel.from_mesh(model_path("objects", "mug.obj"))
    for value, texts in (
        (model, ("'mug'", "mm", "faces", "symmetry: none")),
        (contacts(0), ("4 points, normals, forces", "sigma_position 0.9 mm", "sigma_normal 5 deg")),
        (tp.Contacts(np.zeros((2, 3)), sigma_position=np.array([1e-3, 2e-3])), ("2 points, sigma_position 1 to 2 mm",)),
        (tp.Contacts.empty(), ("<Contacts: 0 points>",)),
        (prior(0), ("p_PO [", "sigma_translation 20 mm", "sigma_rotation 17.2 deg")),
        (estimate(0), ("'ambiguous'", "3 hypotheses in 6.4 ms", "50.0%", "deg")),
        (estimate(0).best, ("quaternion wxyz", "mm")),
        (HandGeometry(np.zeros((2, 3)), np.array([0.01, 0.02])), ("2 spheres, radii 10.0 to 20.0 mm",)),
        (identification(), ("'ok': 1 object in 10.0 ms", "<Identity 1: 'mug' 90.0%>", "unknown 10.0%")),
        (tp.Sphere(0.01), ("<Sphere: radius 0.01, p_SF [0.0, 0.0, 0.0] mm>",)),
        (tp.Superquadric((0.01, 0.02, 0.03), (0.5, 0.6)), ("semi_axes (0.01, 0.02, 0.03), exponents (0.5, 0.6)",)),
        (PoseTracker(model).start(), ("lost: no estimate yet", "0 modes")),
        (tp.describe_patch(np.eye(3), [0.0, 2e3, 3e3], alpha=1e-7), ("2 of 3 cells active", "3 kPa")),
    ):
        shown = repr(value)
        assert len(shown) < 400
        assert "\n" not in shown
        assert [text for text in texts if text not in shown] == []
