import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.motion.object_motion import MotionNoise, move_freely, move_with_fingertips, move_with_palm
from tactopose_drake.core.poses import (
    compose,
    exp_so3,
    make_poses,
    random_rotations,
    skew,
)
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


def test_fingertips_that_turn_about_where_they_touch_rest_there() -> None:
    """An object that two of them have held for a while is as free as by the speed of what touches it."""
    contacts, names, points = Contacts(p_OC[:2], n_OC[:2]), NAMES[:2], p_OC[:2]

    def covariance(turn: np.ndarray, slide: np.ndarray) -> np.ndarray:
        tips = {name: np.concatenate([turn, slide - np.cross(turn, p)]) for name, p in zip(names, points, strict=True)}
        return move_with_fingertips(contacts, names, tips, NOISE, 0.01, slips=False, settled=True).covariance

    turn, slide = np.array([0.4, -0.3, 0.2]), np.array([0.002, 0.003, 0.0])
    for way in (np.zeros(3), slide):
        np.testing.assert_allclose(covariance(turn, way), covariance(np.zeros(3), way), rtol=1e-9, atol=1e-18)
    assert np.trace(covariance(turn, slide)) > np.trace(covariance(turn, np.zeros(3)))


def test_noise_grows_with_slip_but_not_through_the_fingertips() -> None:
    contacts = Contacts(0.03 * n_OC[:2], n_OC[:2])
    held, slipping = (
        move_with_fingertips(contacts, NAMES[:2], velocities(np.zeros(6)), NOISE, 0.01, slips=slips).covariance
        for slips in (False, True)
    )
    assert slipping[4, 4] > 3.0 * held[4, 4]
    assert slipping[5, 5] > 3.0 * held[5, 5]
    assert slipping[3, 3] == pytest.approx(held[3, 3], rel=0.5)


@pytest.mark.parametrize("friction", [None, 0.5])
def test_more_fingertips_do_not_average_out_a_slip(friction: float | None) -> None:
    """It slips as a whole: along x, between fingertips on the faces across y and z, at the limit of friction."""
    noise, f_PC = dataclasses.replace(NOISE, friction=friction), n_OC + 0.5 * np.array([1.0, 0.0, 0.0])
    few, many = ([2, 3], [2, 3, 4, 5])
    spread = {
        slips: [
            move_with_fingertips(
                Contacts(p_OC[at], n_OC[at], f_PC[at] if slips else None),
                [NAMES[i] for i in at],
                velocities(np.zeros(6)),
                noise,
                0.01,
                slips=slips,
            ).covariance[3, 3]
            for at in (few, many)
        ]
        for slips in (False, True)
    }
    assert spread[False][1] < 0.8 * spread[False][0]
    assert spread[True][1] > 0.9 * spread[True][0]


def test_forces_at_the_friction_cone_let_go_of_the_tangent() -> None:
    noise = MotionNoise(friction=0.5)
    along = {"inside": 0.4, "outside": 0.47}  # for forces are noisy
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


def test_what_resting_fingertips_have_held_for_a_while_rests() -> None:
    """Two fingertips leave the turn about the line between them to their twist, and two to nothing."""
    p_PC, n_PC = np.array([[0.05, -0.03, 0.0], [0.05, 0.03, 0.0]]), np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    names = NAMES[:2]

    def walk(speed: float = 0.0, *, count: int = 2, slips: bool = False, settled: bool = True) -> float:
        """Of the turn about the line through both contacts, rad/s^0.5."""
        turn = np.array([0.0, speed / 0.05, 0.0, 0.0, 0.0, 0.0])  # about the palm's axis, which moves both
        motion = move_with_fingertips(
            Contacts(p_PC[:count], n_PC[:count]),
            names[:count],
            dict.fromkeys(names, turn),
            NOISE,
            0.01,
            slips=slips,
            settled=settled,
        )
        assert np.abs(motion.twist).max() <= 0.01 * speed / 0.05 + 1e-12
        return float(np.sqrt(motion.covariance[1, 1] / 0.01))

    assert walk() < 1.01 * NOISE.palm_rotation
    fast, half = 2.0 * NOISE.still_speed, 0.5 * NOISE.still_speed
    assert walk() < 0.5 * walk(half) < 0.5 * walk(fast)
    for free in (walk(settled=False), walk(slips=True), walk(count=1)):
        assert free > 0.7 * walk(fast)
    assert walk(2.0 * fast) == pytest.approx(walk(fast))


@pytest.mark.parametrize("slips", [False, True])
def test_the_motion_is_that_of_least_squares_by_the_rows_of_the_grasp_matrix(slips: bool) -> None:
    """For each contact three of the points' velocities and one of the spin about the normal, from a random walk."""
    generator, known = np.random.default_rng(4), [1, 2, 5]
    noise = MotionNoise(rolling=0.004, twisting=0.3, slipping=0.02)
    p_PC, n_PC = 0.05 * generator.normal(size=(6, 3)), random_rotations(generator, 6)[:, 0]
    tips = {NAMES[i]: generator.normal(size=6) * np.repeat([0.3, 0.02], 3) for i in known}
    across = noise.slipping * np.sqrt(len(known)) if slips else noise.rolling
    rows, measured, sigma = [], [], []
    for i in known:
        R = np.linalg.svd(n_PC[i : i + 1])[2]  # the normal, and two tangents
        to_point = np.hstack([-skew(p_PC[i]), np.eye(3)])
        for direction, of_direction in zip(R, (noise.rolling, across, across), strict=True):
            rows.append(direction @ to_point)
            sigma.append(of_direction)
        rows.append(np.concatenate([n_PC[i], np.zeros(3)]))
        sigma.append(across * noise.twisting / noise.rolling)
        measured += [row @ tips[NAMES[i]] for row in rows[-4:]]
    J, W = np.array(rows), np.diag(np.array(sigma) ** -2.0)
    free = np.repeat([noise.free_rotation, noise.free_translation], 3)
    covariance = np.linalg.inv(J.T @ W @ J + np.diag(free**-2.0))
    motion = move_with_fingertips(Contacts(p_PC, n_PC), NAMES, tips, noise, 0.02, slips=slips)
    np.testing.assert_allclose(motion.covariance, 0.02 * covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(motion.twist, 0.02 * covariance @ J.T @ W @ measured, rtol=1e-6, atol=1e-12)


def test_unknown_fingertips_say_nothing() -> None:
    motion = move_with_fingertips(Contacts(p_OC, n_OC), NAMES, {}, NOISE, 0.01, slips=False)
    free = move_freely(NOISE, 0.01, 0.3)
    np.testing.assert_allclose(motion.twist, 0.0)
    np.testing.assert_allclose(motion.covariance, free.covariance)


def test_noise_adds_up_in_time_as_a_random_walk() -> None:
    for slips in (False, True):
        once, twice = (move_with_palm(NOISE, duration, slips=slips).covariance for duration in (0.01, 0.02))
        np.testing.assert_allclose(twice, 2.0 * once)
    assert np.all(np.diag(move_with_palm(NOISE, 0.01, slips=True).covariance) > np.diag(once) / 25.0)


def test_in_a_still_hand_an_object_turns_and_shifts_as_told_and_turns_more_by_as_much_as_it_shifts_more() -> None:
    for slips, factor in ((False, 1.0), (True, NOISE.slipping / NOISE.palm_translation)):
        motion = move_with_palm(NOISE, 0.25, slips=slips)
        sigma = factor * np.repeat([NOISE.palm_rotation, NOISE.palm_translation], 3) * np.sqrt(0.25)
        np.testing.assert_array_equal(motion.twist, np.zeros(6))
        np.testing.assert_allclose(motion.covariance, np.diag(sigma**2), rtol=1e-12)


def test_an_object_that_nothing_touches_rests_in_the_world() -> None:
    X_WP = make_poses(exp_so3(np.array([0.3, 0.1, -0.2])), np.array([0.5, 0.1, 0.3]))
    X_WP_after = make_poses(exp_so3(np.array([0.4, 0.0, -0.2])), np.array([0.45, 0.2, 0.3]))
    X_PO = make_poses(exp_so3(np.array([1.0, 0.5, 0.0])), np.array([0.1, 0.0, 0.2]))
    motion = move_freely(NOISE, 0.01, 0.3, X_WP, X_WP_after)
    np.testing.assert_allclose(compose(X_WP_after, compose(motion.pose, X_PO)), compose(X_WP, X_PO), atol=1e-12)


def test_where_the_palm_was_or_is_unknown_nothing_tells_whither_it_has_moved() -> None:
    X_WP = make_poses(exp_so3(np.array([0.3, 0.1, -0.2])), np.array([0.5, 0.1, 0.3]))
    for before, after in ((X_WP, None), (None, X_WP), (None, None)):
        motion = move_freely(NOISE, 0.01, 0.3, before, after)
        np.testing.assert_array_equal(motion.twist, np.zeros(6))
        free = 0.01 * np.repeat([NOISE.free_rotation, NOISE.free_translation], 3) ** 2
        np.testing.assert_allclose(motion.covariance, np.diag(free), rtol=1e-12)


def test_in_a_very_long_time_no_more_is_lost_than_there_is_to_know() -> None:
    sigma = np.sqrt(np.diag(move_freely(NOISE, 1e12, 0.3).covariance))
    np.testing.assert_allclose(sigma[3:], 0.3)
    assert sigma[:3].max() < np.pi
