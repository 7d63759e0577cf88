import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import compose, exp_so3, make_poses
from tactopose_drake.core.tracking.object_motion import MotionNoise, move_freely, move_with_fingertips, move_with_palm
from tactopose_drake.errors import InvalidInputError
from tests.core.tracking.boxes import n_OC, p_OC

NAMES = tuple("abcdef")
NOISE = MotionNoise()


def velocities(twist: np.ndarray, slide: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Of fingertips that carry the object along; with sliding ones, (k, 3) more at their contacts."""
    slide = np.zeros((6, 3)) if slide is None else slide
    return {name: twist + np.concatenate([np.zeros(3), slide[i]]) for i, name in enumerate(NAMES)}


def test_fingertips_that_hold_carry_the_object() -> None:
    twist = np.array([0.3, -0.5, 0.2, 0.01, -0.02, 0.03])
    motion = move_with_fingertips(Contacts(p_OC, n_OC), NAMES, velocities(twist), NOISE, 0.01, slips=False)
    np.testing.assert_allclose(motion.twist, 0.01 * twist, rtol=0.03, atol=1e-5)


def test_rolling_fingertips_give_the_velocity_of_the_points_that_touch() -> None:
    """Fingertips that turn otherwise than the object, about their contacts, carry it all the same."""
    twist, generator = np.array([0.3, -0.5, 0.2, 0.01, -0.02, 0.03]), np.random.default_rng(0)
    tips = {}
    for name, p, n in zip(NAMES, p_OC, n_OC, strict=True):
        extra = generator.normal(size=3)
        extra -= extra @ n * n
        tips[name] = twist + np.concatenate([extra, -np.cross(extra, p)])
    motion = move_with_fingertips(Contacts(p_OC, n_OC), NAMES, tips, NOISE, 0.01, slips=False)
    np.testing.assert_allclose(motion.twist, 0.01 * twist, rtol=0.03, atol=1e-5)


def test_noise_grows_with_slip_but_not_through_the_fingertips() -> None:
    contacts = Contacts(0.03 * n_OC[:2], n_OC[:2])
    held, slipping = (
        move_with_fingertips(contacts, NAMES[:2], velocities(np.zeros(6)), NOISE, 0.01, slips=slips).covariance
        for slips in (False, True)
    )
    assert slipping[4, 4] > 3.0 * held[4, 4]
    assert slipping[5, 5] > 3.0 * held[5, 5]
    assert slipping[3, 3] == pytest.approx(held[3, 3], rel=0.5)


def test_more_fingertips_do_not_average_out_a_slip() -> None:
    """It slips as a whole: along x, between fingertips on the faces across y and z."""
    few, many = ([2, 3], [2, 3, 4, 5])
    spread = {
        slips: [
            move_with_fingertips(
                Contacts(p_OC[at], n_OC[at]), [NAMES[i] for i in at], velocities(np.zeros(6)), NOISE, 0.01, slips=slips
            ).covariance[3, 3]
            for at in (few, many)
        ]
        for slips in (False, True)
    }
    assert spread[False][1] < 0.8 * spread[False][0]
    assert spread[True][1] > 0.9 * spread[True][0]


def test_forces_at_the_friction_cone_let_go_of_the_tangent() -> None:
    noise = MotionNoise(friction=0.5)
    along = {"inside": 0.2, "outside": 0.6}
    spread = {}
    for name, share in along.items():
        f_PC = n_OC[:2] + share * np.array([0.0, 1.0, 0.0])
        contacts = Contacts(p_OC[:2], n_OC[:2], f_PC)
        motion = move_with_fingertips(contacts, NAMES[:2], velocities(np.zeros(6)), noise, 0.01, slips=False)
        spread[name] = motion.covariance[4, 4]
    assert spread["outside"] > 3.0 * spread["inside"]


def test_what_no_fingertip_holds_walks_at_random() -> None:
    contacts = Contacts(p_OC[:1], n_OC[:1])
    covariance = move_with_fingertips(contacts, NAMES[:1], velocities(np.zeros(6)), NOISE, 0.01, slips=False).covariance
    free = np.sqrt(np.linalg.eigvalsh(covariance / 0.01)[-1])
    assert free > 0.5 * NOISE.free_rotation


def test_unknown_fingertips_say_nothing() -> None:
    motion = move_with_fingertips(Contacts(p_OC, n_OC), NAMES, {}, NOISE, 0.01, slips=False)
    free = move_freely(NOISE, 0.01)
    np.testing.assert_allclose(motion.twist, 0.0)
    np.testing.assert_allclose(motion.covariance, free.covariance)


def test_noise_adds_up_in_time_as_a_random_walk() -> None:
    for slips in (False, True):
        once, twice = (move_with_palm(NOISE, duration, slips=slips).covariance for duration in (0.01, 0.02))
        np.testing.assert_allclose(twice, 2.0 * once)
    assert np.all(np.diag(move_with_palm(NOISE, 0.01, slips=True).covariance) > np.diag(once) / 25.0)


def test_an_object_that_nothing_touches_rests_in_the_world() -> None:
    X_WP = make_poses(exp_so3(np.array([0.3, 0.1, -0.2])), np.array([0.5, 0.1, 0.3]))
    X_WP_after = make_poses(exp_so3(np.array([0.4, 0.0, -0.2])), np.array([0.45, 0.2, 0.3]))
    X_PO = make_poses(exp_so3(np.array([1.0, 0.5, 0.0])), np.array([0.1, 0.0, 0.2]))
    motion = move_freely(NOISE, 0.01, X_WP, X_WP_after)
    np.testing.assert_allclose(compose(X_WP_after, compose(motion.pose, X_PO)), compose(X_WP, X_PO), atol=1e-12)


@pytest.mark.parametrize("name", ["rolling", "free_rotation", "friction"])
def test_noise_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=name):
        MotionNoise(**{name: -1.0}).validate()
