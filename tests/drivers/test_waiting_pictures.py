import pytest

from tactopose_drake.drivers.waiting_pictures import WaitingPictures


@pytest.mark.parametrize("ahead", [-0.3, 0.0, 0.02, 0.05, 0.1, 0.3, 0.49, 0.6])
def test_no_picture_of_a_camera_ahead_of_the_senses_is_lost(ahead: float) -> None:
    """Thirty pictures a second, a hundred readings: each is taken once, as soon as the senses are as new."""
    waiting, taken, sent = WaitingPictures[int](), [], 0
    for tick in range(400):
        now = 10_000 * tick
        while sent * 1_000_000 // 30 <= now < 3_000_000:
            waiting.add(sent * 1_000_000 // 30 + round(1e6 * ahead), sent)
            sent += 1
        if (picture := waiting.take(now)) is not None:
            taken.append(picture)
            is_waited_for = 0.0 <= ahead <= 0.5
            assert not is_waited_for or 0 <= now - (picture * 1_000_000 // 30 + round(1e6 * ahead)) < 10_000
    assert taken == list(range(sent))
    assert sent == 90


def test_of_those_that_came_meanwhile_the_last_counts() -> None:
    waiting = WaitingPictures[str]()
    assert waiting.take(0) is None
    for utime, name in ((10, "a"), (20, "b"), (400_000, "later"), (30, "c")):
        waiting.add(utime, name)
    assert waiting.take(5) is None
    assert waiting.take(35) == "c"
    assert waiting.take(35) is None
    assert waiting.take(400_000) == "later"


def test_only_so_many_wait() -> None:
    waiting = WaitingPictures[int]()
    for k in range(1000):
        waiting.add(400_000, k)
    assert len(waiting._waiting) == 128
    assert waiting.take(400_000) == 999
