import dataclasses

import numpy as np
import pytest

from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.slip.slip_by_forces import ForceTest, detect_by_forces
from tactopose_drake.core.slip.slip_params import ForceTestParams
from tests.core.tracking.boxes import SIGMA_NORMAL, SIGMA_POSITION, n_OC, p_OC, read

ACROSS = np.roll(n_OC, 1, axis=1)
HELD = np.array([0.5, 0.3, 0.6, 0.2, 0.4, 0.5])
PERIOD = 0.01


def press(ratios: np.ndarray, normal: np.ndarray | float = 2.0) -> ContactReading:
    """Fingertips that press with these normal forces, N, at ratios (6,) of tangential to normal force."""
    forces = (np.ones(6) * normal)[:, None] * (n_OC + ratios[:, None] * ACROSS)
    return read(Contacts(p_OC, n_OC, forces, sigma_position=SIGMA_POSITION, sigma_normal=SIGMA_NORMAL))


def feel(readings: list[ContactReading]) -> list[bool]:
    """At which frames the object is found to slip; at the first all fingers come to touch."""
    test, said = ForceTest(), []
    for i, reading in enumerate(readings):
        test, slips = detect_by_forces(ForceTestParams(), test, reading, PERIOD * i, has_joined=i == 0)
        said.append(slips)
    return said


def test_a_load_that_grows_slowly_within_the_cones_is_no_slip() -> None:
    grows = [press(HELD, 2.0 + 0.05 * i) for i in range(100)]
    assert not any(feel(grows))
    turns = [press(HELD + 0.003 * i * np.array([1, -1, 0, 1, 0, -1])) for i in range(60)]
    assert not any(feel(turns))


def test_forces_change_by_a_part_of_the_larger_whichever_come_first() -> None:
    large, small = np.array([[3.0, 0.0, 4.0], [0.0, 1.0, 0.0]]), np.array([[0.3, 0.0, 0.4], [0.0, 1.0, 0.0]])
    for forces in ([large, small], [small, large]):
        test = ForceTest(times=(0.0, 1.0), forces=np.array(forces))
        np.testing.assert_allclose(test.change_since(0.0), 4.5 / np.sqrt(26.0))


def test_the_sure_change_is_that_since_then_whatever_was_before() -> None:
    """Neither forces as those of now, but longer ago, nor a single bad reading of now changes it."""
    sizes, times = np.array([3.0, 3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 9.0, 3.0, 3.0]), tuple(PERIOD * np.arange(10))
    for factors in ([1.0, 1.0], [3.0, 1.0], [1.0, 3.0]):
        now = np.append(sizes[:8], sizes[8:] * factors)
        test = ForceTest(times=times, forces=now[:, None, None] * np.array([[0.0, 0.6, 0.8]]))
        assert test.sure_change(2.5 * PERIOD) == pytest.approx(2.0 / 3.0)


def test_what_a_coefficient_is_at_the_least_does_not_fall() -> None:
    """Fingers that held at large ratios may hold at smaller ones: they are within their cones then."""
    test, seen = ForceTest(), []
    for i in range(400):
        ratios = HELD if i < 200 else 0.5 * HELD
        test, _ = detect_by_forces(ForceTestParams(), test, press(ratios), PERIOD * i, has_joined=i == 0)
        seen.append(test.ratio)
    assert seen[199] > 0.99 * HELD.max()
    assert min(seen[199:]) == seen[199]


def test_forces_that_go_over_to_other_fingers_at_once_are_a_slip() -> None:
    loose = press(np.array([0.9, 0.3, 0.6, 0.2, 0.4, 0.5]), np.array([0.3, 2, 4, 1, 2, 2]))
    said = feel([press(HELD)] * 50 + [loose] * 5)
    assert said.index(True) == 51, "the second frame confirms what the first says"
    assert not any(feel([press(HELD)] * 10 + [loose] * 5)), "soon after a finger has come to touch forces change"


def test_what_ratios_come_to_while_friction_gives_way_is_no_coefficient() -> None:
    rising = [press(HELD + np.array([0.1 * i, 0, 0, 0, 0, 0])) for i in range(4)]
    loose = press(np.array([0.1, 0.3, 0.61, 0.2, 0.4, 0.5]), np.array([0.1, 2, 4, 1, 2, 2]))
    assert feel([press(HELD)] * 50 + [*rising, loose, loose])[-1]


def test_no_ratio_beyond_what_friction_gives_is_a_coefficient() -> None:
    """A finger that is hooked behind an edge bears more across its normal than along it."""
    test, hooked = ForceTest(), press(np.array([2.5, 0.3, 0.6, 0.2, 0.4, 0.5]))
    for i in range(200):
        test, slips = detect_by_forces(ForceTestParams(), test, hooked, PERIOD * i, has_joined=i == 0)
        assert not slips
    assert test.ratio == ForceTestParams().most_ratio


def test_forces_that_always_change_so_much_are_noise() -> None:
    generator = np.random.default_rng(0)
    shaking = [press(HELD, 2.0 * (1.0 + 0.15 * generator.normal(size=6))) for _ in range(300)]
    assert not any(feel(shaking)[100:])


def test_forces_that_change_by_more_than_where_friction_gives_way_are_noise_where_they_always_do() -> None:
    """Also where a finger is at the limit of friction."""
    generator, at_limit = np.random.default_rng(0), np.array([0.9, 0.3, 0.6, 0.2, 0.4, 0.5])
    shaking = [press(at_limit, 2.0 * (1.0 + 0.5 * generator.uniform(-1.0, 1.0, 6))) for _ in range(400)]
    assert not any(feel(shaking)[200:])


def test_a_single_reading_that_is_far_off_is_no_slip() -> None:
    """Neither as it comes nor later, when forces are compared with it."""
    held = np.array([0.9, 0.3, 0.6, 0.2, 0.4, 0.5])
    spike = press(np.array([0.9, 0.9, 0.6, 0.2, 0.4, 0.5]), np.array([2.0, 12.0, 2, 2, 2, 2]))
    assert not any(feel(([press(held)] * 50 + [spike]) * 3 + [press(held)] * 20))


def test_a_knock_within_the_cones_is_no_slip() -> None:
    assert not any(feel([press(HELD)] * 50 + [press(0.5 * HELD, 4.0)] * 5))


def test_a_finger_whose_reading_is_lost_has_not_let_go() -> None:
    """Neither as it goes nor as it comes again, though another finger is at the limit of friction meanwhile."""
    others = np.array([0, 1, 3, 4, 5])
    at_limit = press(np.array([0.9, 0.3, 0.6, 0.2, 0.4, 0.5]), np.array([2.0, 2, 4, 2, 2, 2]))
    without = read(at_limit.contacts[others], others)
    assert not any(feel([at_limit] * 50 + [without, *[at_limit] * 4] * 10))


def test_where_the_fingers_that_bear_the_load_are_lost_the_noise_of_the_others_is_no_slip() -> None:
    generator, others = np.random.default_rng(0), np.array([2, 3, 4, 5])
    said = []
    for i in range(600):
        reading = press(np.array([0.9, 0.3, 0.6, 0.2, 0.4, 0.5]), np.array([6.0, 6.0, 0.3, 0.3, 0.3, 0.3]))
        forces = reading.contacts.f_PC + 0.03 * generator.normal(size=(6, 3))
        contacts = dataclasses.replace(reading.contacts, f_PC=forces)
        said.append(read(contacts) if i % 20 else read(contacts[others], others))
    assert not any(feel(said)[60:])


def test_where_all_fingers_come_to_the_limit_the_object_slides_as_a_whole() -> None:
    reach = [press(np.minimum(HELD + 0.01 * i, 0.8)) for i in range(100)]
    said = feel(reach)
    assert 50 <= said.index(True) <= 60
    assert not any(said[:50])


def test_fingers_that_rest_at_the_limit_since_they_closed_do_not_slide() -> None:
    assert not any(feel([press(np.full(6, 0.8))] * 100))


def test_fingers_that_share_a_load_alike_hold_however_noisy_their_forces_are() -> None:
    for ratio, noise in ((0.35, 0.01), (0.4, 0.002), (0.4, 0.01), (0.6, 0.02)):
        generator, said = np.random.default_rng(0), []
        held = [press(np.full(6, ratio)) for _ in range(300)]
        for reading in held:
            forces = reading.contacts.f_PC + noise * generator.normal(size=(6, 3))
            said.append(read(dataclasses.replace(reading.contacts, f_PC=forces)))
        assert not any(feel(said))


def test_two_fingers_at_equal_ratios_prove_nothing() -> None:
    for growth in (1.0, 1.014):
        two = [press(np.minimum(HELD + 0.01 * i, 0.8), 2.0 * growth**i).contacts[:2] for i in range(100)]
        assert not any(feel([read(contacts) for contacts in two]))


def load(first: int, most: float = 0.8, until: int = 200, larger: float = 0.0) -> list[ContactReading]:
    """A load that grows until a frame; two fingers' ratios grow to the most from a frame on, one's may be larger."""
    readings = []
    for i in np.minimum(np.arange(200), until):
        ratios = HELD + 0.0005 * i
        ratios[:2] = np.minimum(HELD[:2] + 0.01 * max(i - first, 0), most)
        ratios[2] += larger
        readings.append(press(ratios, 2.0 * 1.014 ** np.array([0, 0, i, i, i, i])))
    return readings


def test_two_fingers_that_come_to_the_limit_while_the_load_grows_slide() -> None:
    said = feel(load(50))
    comes = 50 + 100 * (0.8 - HELD[:2].min())
    assert comes <= said.index(True) <= comes + 6


def test_fingers_whose_ratios_stay_because_the_load_does_hold() -> None:
    assert not any(feel(load(50, until=round(50 + 100 * (0.8 - HELD[:2].min())))))


def test_fingers_that_have_long_been_at_equal_ratios_hold_while_the_load_grows() -> None:
    assert not any(feel(load(-100)))


def test_fingers_below_anothers_ratio_are_not_at_the_limit() -> None:
    assert not any(feel(load(50, most=0.75, larger=0.85 - HELD[2])))
    assert any(feel(load(50, most=0.75)))


def test_below_the_least_ratio_nothing_slides() -> None:
    for most, slides in ((0.25, False), (0.35, True)):
        readings = []
        for i in range(150):
            ratios = np.array([0.0, 0.0, 0.2, 0.2, 0.15, 0.15])
            ratios[:2] = min(0.01 * max(i - 50, 0), most)
            readings.append(press(ratios, 2.0 * 1.014 ** np.array([0, 0, i, i, i, i])))
        assert any(feel(readings)) == slides


def test_a_finger_that_bears_hardly_a_part_of_the_load_has_no_say() -> None:
    """Whatever its ratio is, it is that of noise."""
    for light in (0.08, 0.8):
        normal = np.array([2.0, 2.0, 2.0, 2.0, 2.0, light])
        reach = [press(np.append(np.minimum(HELD[:5] + 0.01 * i, 0.8), 0.95), normal) for i in range(100)]
        assert any(feel(reach)) == (light < 0.1)


def test_fingers_that_touch_without_a_load_say_nothing() -> None:
    assert not any(feel([press(HELD)] * 50 + [press(HELD, 0.0)] * 20))


def test_fingers_that_have_been_at_the_limit_all_along_do_not_slide_as_the_load_grows() -> None:
    """They have shared it alike since they closed: where friction ends, nothing has shown."""
    assert not any(feel([press(np.full(6, 0.35 + 0.003 * i)) for i in range(100)]))


def test_without_forces_nothing_is_said_of_them() -> None:
    bare = read(dataclasses.replace(press(HELD).contacts, f_PC=None))
    begun = ForceTest(held_time=1.0)
    assert detect_by_forces(ForceTestParams(), ForceTest(), bare, 1.0, has_joined=True) == (begun, False)
