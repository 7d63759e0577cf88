import numpy as np
import pytest
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.objectives.friction_cone import FrictionCone
from tactopose_drake.core.objectives.penetration import Penetration
from tactopose_drake.core.poses import retract
from tactopose_drake.core.searches.pose_problem import make_problem
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.shape.symmetry import RotationalSymmetry
from tactopose_drake.errors import InvalidInputError

RADIUS, HEIGHT = 0.033, 0.115
IDENTITY = np.eye(3, 4)[None]
# Two fingertips of 8 mm hold the can from both sides, half a millimetre into their skin, and carry it.
CONTACTS = Contacts(
    [[RADIUS, 0.0, 0.0], [-RADIUS, 0.0, 0.0]],
    [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
    [[4.0, 0.0, -1.0], [-4.0, 0.0, -1.0]],
)
TIPS = HandGeometry([[RADIUS + 0.0075, 0.0, 0.0], [-RADIUS - 0.0075, 0.0, 0.0]], [0.008, 0.008])
GRAVITY = ForceBalance([0.0, 0.0, -10.0])


def make_can(**options: object) -> ObjectModel:
    mesh = trimesh.creation.cylinder(radius=RADIUS, height=HEIGHT, sections=64)
    return ObjectModel.from_mesh(mesh, **{"mass": 0.2, **options})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def can() -> ObjectModel:
    return make_can()


def test_all_evidence_agrees_with_the_truth(can: ObjectModel) -> None:
    touch = make_problem(can, Evidence(CONTACTS)).objective.cost(IDENTITY)[0]
    everything = Evidence(CONTACTS, hand=TIPS, balance=GRAVITY, friction=0.3)
    assert make_problem(can, everything).objective.cost(IDENTITY)[0] == pytest.approx(touch, abs=1e-6)


@pytest.mark.parametrize(
    ("evidence", "least"),
    [
        # A finger through the can; one that feels nothing, though the can presses it by half a millimetre.
        (Evidence(CONTACTS, hand=HandGeometry([[0.0, 0.02, 0.0]], [0.008])), 50.0),
        (Evidence(CONTACTS, untouched=HandGeometry([[RADIUS + 0.0075, 0.0, 0.0]], [0.008])), 0.05),
        # The can hangs to the side, where the two forces cannot hold it.
        (Evidence(CONTACTS, balance=ForceBalance([0.0, 10.0, 0.0])), 50.0),
        # The fingers are dry; the forces lean by 14 degrees.
        (Evidence(CONTACTS, friction=0.0), 3.0),
    ],
)
def test_each_evidence_counts(can: ObjectModel, evidence: Evidence, least: float) -> None:
    touch = make_problem(can, Evidence(CONTACTS)).objective.cost(IDENTITY)[0]
    problem = make_problem(can, evidence)
    assert problem.objective.cost(IDENTITY)[0] > touch + least
    assert problem.touch.cost(IDENTITY)[0] == pytest.approx(touch)


def test_the_prior_is_no_part_of_the_likelihood(can: ObjectModel) -> None:
    prior = GaussianPrior(np.column_stack([np.eye(3), [0.03, 0.0, 0.0]]), sigma_translation=0.01)
    problem = make_problem(can, Evidence(CONTACTS, prior, hand=TIPS))
    both = problem.objective.cost(IDENTITY)[0]
    assert both - problem.likelihood.cost(IDENTITY)[0] == pytest.approx(4.5)


def test_what_only_bounds_the_pose_determines_nothing(can: ObjectModel) -> None:
    through = HandGeometry([[0.0, 0.02, 0.0]], [0.008])
    bounded = make_problem(can, Evidence(CONTACTS, hand=through, untouched=through, friction=0.0))
    assert bounded.determining.cost(IDENTITY)[0] == pytest.approx(bounded.touch.cost(IDENTITY)[0])
    held = make_problem(can, Evidence(CONTACTS, hand=through, balance=ForceBalance([0.0, 10.0, 0.0])))
    assert held.touch.cost(IDENTITY)[0] + 50.0 < held.determining.cost(IDENTITY)[0]
    assert held.determining.cost(IDENTITY)[0] + 50.0 < held.likelihood.cost(IDENTITY)[0]


def test_balance_needs_a_mass() -> None:
    with pytest.raises(
        InvalidInputError, match="model must have a mass for the balance, but that of 'mesh' is not known"
    ):
        make_problem(make_can(mass=None), Evidence(CONTACTS, balance=GRAVITY))


def test_balance_needs_symmetries_that_keep_the_centre_of_mass() -> None:
    # Half full: not to be turned upside down, though its surface may.
    half_full = [0.0, 0.0, -0.02]
    with pytest.raises(InvalidInputError, match="not those of 'mesh', which move it by 40 mm"):
        make_problem(make_can(center_of_mass=half_full), Evidence(CONTACTS, balance=GRAVITY))
    upright = [RotationalSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3), 0)]
    make_problem(make_can(center_of_mass=half_full, symmetry=upright), Evidence(CONTACTS, balance=GRAVITY))


@pytest.mark.parametrize(
    ("evidence", "message"),
    [
        ({"friction": -0.1}, "friction must be a number >= 0, not -0.1"),
        ({"friction": np.nan}, "friction must be .*, not nan"),
        ({"contacts": CONTACTS.p_PC}, "contacts must be a Contacts, not an ndarray"),
        ({"prior": np.eye(4)}, "prior must be a PosePrior, not an ndarray"),
        ({"hand": GRAVITY}, "hand must be a HandGeometry, not a ForceBalance"),
        ({"contacts": None}, "contacts must be a Contacts, not None"),
        (
            {"contacts": Contacts(CONTACTS.p_PC), "friction": 0.5},
            "contacts must have forces f_PC for the friction, not None",
        ),
        (
            {"contacts": Contacts(CONTACTS.p_PC), "balance": GRAVITY},
            "contacts must have forces f_PC for the balance, not None",
        ),
    ],
)
def test_evidence_that_does_not_fit_is_refused(evidence: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Evidence(**{"contacts": CONTACTS, **evidence})  # type: ignore[arg-type]


@pytest.mark.parametrize("with_friction", [False, True])
@pytest.mark.parametrize("with_prior", [False, True])
def test_what_one_loop_does_is_the_sum_of_its_parts(can: ObjectModel, with_prior: bool, with_friction: bool) -> None:
    """Contacts, believed and doubted, a prior, the hand's volume, and its parts that feel nothing."""
    prior = GaussianPrior(IDENTITY[0], sigma_translation=0.02, sigma_rotation=0.3) if with_prior else None
    untouched = HandGeometry([[0.0, RADIUS + 0.004, 0.0]], [0.008], sigma=0.002)
    problem = make_problem(
        can,
        Evidence(CONTACTS, prior, hand=TIPS, untouched=untouched, friction=0.2 if with_friction else None),
    )
    assert problem.mixture is not None
    hands = [Penetration(can.grid, TIPS, 2.0 * TIPS.sigma), Penetration(can.grid, untouched)]
    others = [*hands, *([] if problem.prior is None else [problem.prior])]
    if with_friction:
        others.append(FrictionCone(can.grid, CONTACTS, 0.2))
    X_PO = retract(IDENTITY, 0.01 * np.random.default_rng(1).normal(size=(30, 6)))
    assert all(np.count_nonzero(hand.cost(X_PO)) > 5 for hand in hands)
    doubted = problem.doubted(problem.objective)
    for whole, contacts in ((problem.objective, problem.touch), (doubted, problem.mixture)):
        # Friction is part of no compiled loop; the rest is.
        assert (whole.descent is None) == with_friction
        parts = [contacts, *others]
        np.testing.assert_allclose(whole.cost(X_PO), sum(part.cost(X_PO) for part in parts), rtol=1e-9)
        np.testing.assert_allclose(whole.exact_cost(X_PO), sum(part.exact_cost(X_PO) for part in parts), rtol=1e-9)
        for mine, *each in zip(
            whole.normal_equations(X_PO), *(part.normal_equations(X_PO) for part in parts), strict=True
        ):
            np.testing.assert_allclose(mine, sum(each), rtol=1e-7, atol=1e-9 * np.abs(mine).max())
