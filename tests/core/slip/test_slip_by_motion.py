import numpy as np
import pytest
from scipy import stats

from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import skew
from tactopose_drake.core.slip.slip_by_motion import RigidityTest, detect_by_motion
from tactopose_drake.core.slip.slip_params import RigidityTestParams
from tests.core.tracking.boxes import n_OC, p_OC, read

PARAMS, PERIOD = RigidityTestParams(), 0.01
TWIST = np.array([0.5, -0.8, 0.3, 0.03, -0.02, 0.04])
REST, ALONG = np.zeros(6), np.array([0.0, 0.0, 0.0, 0.6, -0.64, 0.48])


def touch(chosen: np.ndarray | slice = slice(None)) -> ContactReading:
    return read(Contacts(p_OC[chosen], n_OC[chosen]))


def moves(carried: np.ndarray, errors: np.ndarray) -> dict[str, np.ndarray]:
    """Velocities of fingertips that carry an object, with errors (6, 3), m/s, where they touch."""
    names = touch().sources
    return {name: carried + np.append(np.zeros(3), error) for name, error in zip(names, errors, strict=True)}


def calls(
    velocities: list[dict[str, np.ndarray]],
    readings: list[ContactReading] | None = None,
    durations: np.ndarray | None = None,
) -> list[bool]:
    """At which frames, of these durations, a fingertip is found to slide."""
    test, said, time = RigidityTest(), [], 0.0
    for i, velocity in enumerate(velocities):
        reading, duration = touch() if readings is None else readings[i], PERIOD if durations is None else durations[i]
        time += duration
        test, slides = detect_by_motion(PARAMS, test, reading, velocity, time, duration)
        said.append(slides)
    return said


def noisy(
    generator: np.random.Generator, frames: int, carried: np.ndarray, sigma: float
) -> list[dict[str, np.ndarray]]:
    return [moves(carried, sigma * generator.normal(size=(6, 3))) for _ in range(frames)]


def test_fingertips_that_carry_an_object_do_not_slide() -> None:
    for seed, carried in enumerate([REST, TWIST, 3.0 * TWIST]):
        assert not any(calls(noisy(np.random.default_rng(seed), 1000, carried, 0.002)))


@pytest.mark.parametrize("sigma", [0.003, 0.01])
def test_frames_of_uneven_length_are_no_slide(sigma: float) -> None:
    generator = np.random.default_rng(7)
    durations = PERIOD * generator.choice([1.0, 1.0, 1.0, 1.0, 5.0], size=2000)
    said = calls(noisy(generator, len(durations), REST, sigma), durations=durations)
    assert not any(said[100:])  # By then the noise is known.


def test_the_noise_that_frames_show_is_theirs() -> None:
    generator, test, found, time = np.random.default_rng(5), RigidityTest(), [], 0.0
    for velocity in noisy(generator, 1200, TWIST, 0.004):
        duration = PERIOD * generator.choice([1.0, 3.0])
        time += duration
        test, _ = detect_by_motion(PARAMS, test, touch(), velocity, time, duration)
        found.append(test.noise)
    assert np.sqrt(np.mean(found[200:])) == pytest.approx(0.004, rel=0.1)


def test_no_single_frame_makes_much_more_noise_of_a_little() -> None:
    """By whatever it differs from the last one, it counts as four times the variance so far."""
    generator, test, time = np.random.default_rng(5), RigidityTest(), 0.0
    for velocity in [*noisy(generator, 200, TWIST, 0.002), moves(TWIST, 0.5 * generator.normal(size=(6, 3)))]:
        before, time = test.noise, time + PERIOD
        test, _ = detect_by_motion(PARAMS, test, touch(), velocity, time, PERIOD)
    assert before is not None
    assert test.noise == pytest.approx(before * (1.0 + 3.0 * PARAMS.noise_gain))


def test_fingertips_that_turn_as_they_roll_do_not_slide() -> None:
    generator = np.random.default_rng(0)
    rolling = moves(TWIST, np.zeros((6, 3)))
    for (name, velocity), p in zip(rolling.items(), p_OC, strict=True):
        turn = generator.normal(size=3)
        rolling[name] = velocity + np.concatenate([turn, -np.cross(turn, p)])
    assert not any(calls([rolling] * 100))


def test_one_that_slides_is_noticed_within_its_first_two_millimetres() -> None:
    for seed, speed in enumerate([0.03, 0.05, 0.1, 0.2]):
        generator = np.random.default_rng(seed)
        sliding = np.zeros((6, 3))
        sliding[2] = speed * ALONG[3:]
        begins = [moves(TWIST, sliding + 0.002 * generator.normal(size=(6, 3))) for _ in range(20)]
        said = calls([*noisy(generator, 50, TWIST, 0.002), *begins])
        assert not any(said[:50])
        assert PERIOD * (said.index(True) - 49) * speed <= 0.002
        assert all(said[said.index(True) :]), "and for as long as it slides"


def test_what_kinematics_err_along_the_way_is_no_slide() -> None:
    fast = 5.0 * TWIST
    reach = np.cross(fast[:3], p_OC) + fast[3:]
    for seed in range(6):
        wrong = PARAMS.way_share * np.random.default_rng(seed).normal(size=(6, 1))  # for good, as a hand's errors are
        assert not any(calls([moves(fast, wrong * reach)] * 50))


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_a_slide_is_one_from_a_least_distance_on_that_is_the_mean_square_of_all_fingertips(factor: float) -> None:
    """Of velocities without noise, what no twist explains of the displacements of one frame."""
    params = RigidityTestParams(velocity_noise=1e-9, least_velocity_noise=1e-9, way_share=1e-9)
    sliding = np.zeros((6, 3))
    sliding[2] = ALONG[3:]
    J = np.concatenate([np.hstack([-skew(p), np.eye(3)]) for p in p_OC])
    left = sliding.ravel() - J @ np.linalg.lstsq(J, sliding.ravel())[0]
    speed = factor * params.least_distance / (PERIOD * np.sqrt(np.mean(np.square(left).reshape(6, 3).sum(axis=1))))
    test, said = RigidityTest(), []
    for i, velocity in enumerate([*[0.0 * sliding] * 8, speed * sliding]):
        test, slides = detect_by_motion(params, test, touch(), moves(REST, velocity), PERIOD * i, PERIOD)
        said.append(slides)
    assert said == [False] * 8 + [factor > 1.0]


@pytest.mark.parametrize("fingers", [3, 4, 6])
@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_slide_exceeds_what_is_due_to_noise_that_is_itself_estimated(fingers: int, factor: float) -> None:
    """Of single frames: the sum of squares over the estimated variance has an F distribution."""
    params = RigidityTestParams(time=PERIOD, least_distance=1e-9, way_share=1e-9)
    sliding = np.zeros((6, 3))
    sliding[2] = ALONG[3:]
    J = np.concatenate([np.hstack([-skew(p), np.eye(3)]) for p in p_OC[:fingers]])
    rows = sliding[:fingers].ravel()
    left, freedom = rows - J @ np.linalg.lstsq(J, rows)[0], 3 * fingers - 6
    limit = freedom * stats.f.isf(params.false_alarm_probability, freedom, freedom * (2.0 / params.noise_gain - 1.0))
    speed = factor * params.velocity_noise * np.sqrt(limit) / np.linalg.norm(left)
    test, said = RigidityTest(), []
    for i, each in enumerate([0.0 * sliding, speed * sliding]):
        test, slides = detect_by_motion(params, test, touch(np.arange(fingers)), moves(REST, each), PERIOD * i, PERIOD)
        said.append(slides)
    assert said == [False, factor > 1.0]


def test_velocities_that_are_noisier_than_told_are_learnt_to_be() -> None:
    said = calls(noisy(np.random.default_rng(2), 400, REST, 0.01))
    assert any(said[:30])
    assert not any(said[100:])


@pytest.mark.parametrize("frames", [2, 5, 10, 30])
def test_velocities_that_are_read_more_rarely_than_frames_come_are_no_slide(frames: int) -> None:
    for seed in range(5):
        read = noisy(np.random.default_rng(seed), 600 // frames, TWIST, 0.003)
        assert not any(calls([velocity for velocity in read for _ in range(frames)]))


def test_one_that_slides_is_noticed_by_velocities_that_are_read_at_every_other_frame() -> None:
    generator, sliding = np.random.default_rng(0), np.zeros((6, 3))
    sliding[2] = 0.1 * ALONG[3:]
    begins = [moves(TWIST, sliding + 0.002 * generator.normal(size=(6, 3))) for _ in range(10)]
    said = calls([velocity for velocity in [*noisy(generator, 50, TWIST, 0.002), *begins] for _ in range(2)])
    assert not any(said[:100])
    assert said.index(True) - 100 < 4


def test_two_fingertips_prove_nothing() -> None:
    two = touch(np.arange(2))
    sliding = {name: np.append(np.zeros(3), [0.1 * i, 0.2, 0.0]) for i, name in enumerate(two.sources)}
    assert not any(calls([sliding] * 20, [two] * 20))


def test_a_fingertip_on_its_way_to_the_object_is_bound_by_nothing() -> None:
    comes = np.zeros((6, 3))
    comes[5] = 0.3 * ALONG[3:]
    few = touch(np.arange(5))
    velocities = [moves(REST, comes)] * 11 + [moves(REST, np.zeros((6, 3)))] * 10
    assert not any(calls(velocities, [few] * 10 + [touch()] * 11))


def test_frames_that_come_twice_at_the_same_time_hide_no_slide() -> None:
    generator, sliding = np.random.default_rng(0), np.zeros((6, 3))
    sliding[2] = 0.05 * ALONG[3:]
    velocities = [moves(TWIST, sliding + 0.002 * generator.normal(size=(6, 3))) for _ in range(40)]
    twice = calls([velocity for velocity in velocities for _ in range(2)], durations=np.tile([PERIOD, 0.0], 40))
    assert twice[::2] == calls(velocities)
    assert any(twice)


def test_unknown_velocities_say_nothing() -> None:
    test, slides = detect_by_motion(PARAMS, RigidityTest(noise=1e-6), touch(), None, 1.0, PERIOD)
    assert (test, slides) == (RigidityTest(noise=1e-6), False)


def test_fingertips_on_a_line_are_a_rigid_body_too() -> None:
    """A turn about the line moves none of them; that one goes another way is noticed all the same."""
    line = read(Contacts(np.linspace(-0.05, 0.05, 6)[:, None] * n_OC[2], np.tile(n_OC[0], (6, 1))))
    held = noisy(np.random.default_rng(0), 200, TWIST, 0.002)
    assert not any(calls(held, [line] * 200))
    sliding = np.zeros((6, 3))
    sliding[2] = 0.1 * ALONG[3:]
    assert any(calls([*held[:50], *[moves(TWIST, sliding)] * 10], [line] * 60))
