import contextlib
import os
import resource
import sys

import numpy as np
import pytest

from tactopose_drake.drivers.lcm_inbox import LcmInbox, open_lcm
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectPoseMessage
from tactopose_drake.errors import BusError, InvalidInputError

pytest.importorskip("lcm")


def send(link, *sequences: int) -> None:
    for sequence in sequences:
        link.publish("SENSES", HandSensesMessage(utime=1000 * sequence, sequence=sequence).encode())


def test_all_messages_are_taken_in_and_the_newest_is_used() -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES")
    inbox.wait(0.0)
    assert inbox.take() is None
    send(link, *range(100))
    inbox.wait(0.1)
    newest = inbox.take()
    assert newest is not None
    assert newest.sequence == 99
    assert inbox.take() is None
    assert (inbox.received, inbox.lost, inbox.passed_over) == (100, 0, 99)
    assert inbox.take_remarks() == ()


def test_none_is_lost_while_nobody_looks() -> None:
    url = f"udpm://239.255.76.67:{20000 + os.getpid() % 20000}?ttl=0"
    try:
        link = open_lcm(url)
    except BusError as error:
        pytest.skip(f"there is no multicast here: {error}")
    inbox = LcmInbox(open_lcm(url), "SENSES")
    send(link, *range(200))
    inbox.wait(2.0)
    if inbox.take() is None:
        pytest.skip("multicast does not come back to this machine")
    for _ in range(20):
        inbox.wait(0.05)
    assert (inbox.received, inbox.lost) == (200, 0)


def test_messages_come_where_the_process_has_many_files_open() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 1200  # LCM waits by `select`, which overruns its stack from 1024 on.
    if hard != resource.RLIM_INFINITY and hard < wanted:
        pytest.skip(f"a process may not have more than {hard} files open here")
    with contextlib.ExitStack() as files:
        files.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, wanted), hard))
        while files.enter_context(open(os.devnull)).fileno() < 1100:
            pass
        link = open_lcm("memq://")
        inbox = LcmInbox(link, "SENSES")
        send(link, 3, 4)
        inbox.wait(0.1)
    newest = inbox.take()
    assert newest is not None
    assert newest.sequence == 4


def test_an_inbox_that_is_dropped_closes_its_connection() -> None:
    inbox = LcmInbox(open_lcm("memq://"), "SENSES", "VISION")
    descriptor = inbox._connection.fileno()
    assert os.fstat(descriptor)
    del inbox
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)


def test_what_is_missing_is_counted_and_said_once() -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES")
    send(link, 0, 1, 5, 6)
    inbox.wait(0.1)
    assert (inbox.received, inbox.lost) == (4, 3)
    assert inbox.take_remarks() == ("3 messages of the senses were lost",)
    assert inbox.take_remarks() == ()


@pytest.mark.parametrize(
    ("sequences", "lost", "said"),
    [
        ((0, 2), 1, "1 message of the senses was lost"),
        ((3, 3 + 10**6), 999_999, "999999 messages of the senses were lost"),
        ((3, 4 + 10**6), 0, "the senses' sender began anew"),
    ],
)
def test_a_gap_is_lost_messages_unless_it_is_another_counter(sequences: tuple[int, int], lost: int, said: str) -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES")
    send(link, *sequences)
    inbox.wait(0.1)
    assert (inbox.received, inbox.lost) == (2, lost)
    assert inbox.take_remarks() == (said,)


def test_what_was_overtaken_or_comes_twice_is_passed_over() -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES")
    send(link, 5, 7, 6, 7, 8)
    inbox.wait(0.1)
    newest = inbox.take()
    assert newest is not None
    assert newest.sequence == 8
    assert (inbox.received, inbox.lost, inbox.passed_over) == (5, 1, 4)
    assert inbox.take_remarks() == ("1 message of the senses was lost",)
    # A second of its own clock earlier, it is another sender.
    send(link, 1009, 9)
    inbox.wait(0.1)
    newest = inbox.take()
    assert newest is not None
    assert newest.sequence == 9
    assert inbox.take_remarks()[-1] == "the senses' sender began anew"


def test_a_sender_that_begins_anew_is_said_and_nothing_is_lost() -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES")
    send(link, 7, 8, 0, 1)
    inbox.wait(0.1)
    assert inbox.lost == 0
    assert inbox.take_remarks() == ("the senses' sender began anew",)


def test_what_is_no_message_is_said_and_the_next_is_taken() -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES", "VISION")
    link.publish("SENSES", b"nonsense that is long enough")
    link.publish("VISION", HandSensesMessage().encode())
    send(link, 3)
    link.publish("VISION", ObjectPoseMessage(utime=5, covariance=np.eye(6)).encode())
    inbox.wait(0.1)
    remarks = inbox.take_remarks()
    assert len(remarks) == 2
    assert all("of this version" in remark for remark in remarks)
    newest, vision = inbox.take(), inbox.take_vision(5)
    assert newest is not None
    assert newest.sequence == 3
    assert vision is not None
    assert vision.utime == 5
    assert inbox.take_vision(5) is None


def test_a_picture_waits_for_senses_of_its_time() -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES", "VISION")
    link.publish("VISION", ObjectPoseMessage(utime=1_000_000).encode())
    inbox.wait(0.1)
    assert inbox.take_vision(999_999) is None
    assert inbox.take_vision(600_000) is None
    assert inbox.take_vision(1_000_000) is not None
    link.publish("VISION", ObjectPoseMessage(utime=9_000_000).encode())
    inbox.wait(0.1)
    assert inbox.take_vision(1_000_000) is not None  # The belief says that it is of the future.


def test_a_url_that_is_none_is_said(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BusError, match="'nonsense://' cannot be opened"):
        open_lcm("nonsense://")


def test_without_the_package_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lcm", None)
    with pytest.raises(InvalidInputError, match=r"pip install tactopose_drake\[lcm\]"):
        open_lcm("memq://")


def test_a_message_that_was_overtaken_or_comes_twice_is_passed_over() -> None:
    link = open_lcm("memq://")
    inbox = LcmInbox(link, "SENSES")
    send(link, 4, 3, 4, 5)
    inbox.wait(0.1)
    newest = inbox.take()
    assert newest is not None
    assert newest.sequence == 5
    assert (inbox.received, inbox.lost, inbox.passed_over) == (4, 0, 3)
    assert inbox.take_remarks() == ()
