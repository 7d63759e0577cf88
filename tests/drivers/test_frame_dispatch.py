import math

import can
import pytest

from tactopose_drake.drivers.clock import VirtualClock
from tactopose_drake.drivers.frame_dispatch import FrameDispatch
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.errors import InvalidInputError


class Told:
    """A device that keeps what it is told."""

    def __init__(self, name: str, requests: set[int], replies: set[int], due: float = math.inf) -> None:
        self.name, self.requests, self.replies = name, frozenset(requests), frozenset(replies)
        self.due = due
        self.heard: list[tuple[str, object]] = []

    def restart(self, time: float) -> None:
        self.heard.append(("restart", time))

    def handle(self, frame: can.Message, time: float) -> None:
        self.heard.append(("handle", frame.arbitration_id))

    def poll(self, time: float) -> None:
        self.heard.append(("poll", time))

    def follow(self, request: can.Message, time: float) -> None:
        self.heard.append(("follow", request.arbitration_id))


@pytest.fixture
def thumb() -> Told:
    return Told("thumb", {1}, {2, 3}, due=5.0)


@pytest.fixture
def index() -> Told:
    return Told("index", {11}, {12}, due=7.0)


@pytest.fixture
def dispatch(thumb: Told, index: Told) -> FrameDispatch:
    dispatch = FrameDispatch()
    for device in (thumb, index):
        dispatch.attach(device)
    return dispatch


def test_a_reply_goes_to_its_owner_and_a_recorded_request_to_who_asks_so(
    dispatch: FrameDispatch, thumb: Told, index: Told
) -> None:
    for identifier in (2, 12, 3, 99, 1):
        dispatch.hand_on(data_frame(identifier, b""), 1.0)
    for identifier in (1, 11, 99, 2):
        dispatch.follow(data_frame(identifier, b""))
    assert thumb.heard == [("handle", 2), ("handle", 3), ("follow", 1)]
    assert index.heard == [("handle", 12), ("follow", 11)]


def test_a_device_that_left_is_told_nothing_more(dispatch: FrameDispatch, thumb: Told, index: Told) -> None:
    dispatch.detach(thumb)
    dispatch.start(VirtualClock(1.0))
    dispatch.hand_on(data_frame(2, b""), 1.0)
    dispatch.follow(data_frame(1, b""))
    dispatch.poll(100.0)
    assert thumb.heard == []
    assert index.heard == [("restart", 1.0), ("poll", 100.0)]
    dispatch.attach(Told("thumb again", {1}, {2, 3}))


def test_devices_start_once_and_all_anew_after_a_failure(dispatch: FrameDispatch, thumb: Told, index: Told) -> None:
    assert dispatch.due(follows_log=True) == 0.0
    for time in (1.0, 2.0):
        dispatch.start(VirtualClock(time))
    dispatch.renew()
    dispatch.start(VirtualClock(3.0))
    for device in (thumb, index):
        assert device.heard == [("restart", 1.0), ("restart", 3.0)]


def test_only_what_is_due_is_polled_and_a_log_waits_for_nobody(
    dispatch: FrameDispatch, thumb: Told, index: Told
) -> None:
    dispatch.start(VirtualClock(0.0))
    assert dispatch.due(follows_log=False) == 5.0
    assert dispatch.due(follows_log=True) == math.inf
    dispatch.poll(5.0)
    assert ("poll", 5.0) in thumb.heard
    assert ("poll", 5.0) not in index.heard


def test_listeners_hear_all_and_errors_are_no_replies(dispatch: FrameDispatch, thumb: Told) -> None:
    heard: list[can.Message] = []
    dispatch.listen(heard.append)
    off = can.Message(arbitration_id=0x40, is_error_frame=True)
    other_error = can.Message(arbitration_id=0x2, is_error_frame=True)
    for frame in (data_frame(99, b""), off, other_error):
        dispatch.hand_on(frame, 1.0)
    assert len(heard) == 3
    assert (dispatch.error_frames, dispatch.is_bus_off, thumb.heard) == (2, True, [])
    dispatch.ignore(heard.append)
    dispatch.hand_on(data_frame(99, b""), 1.0)
    assert len(heard) == 3
    assert not dispatch.is_bus_off


def test_two_devices_with_one_identifier_are_refused(dispatch: FrameDispatch) -> None:
    with pytest.raises(
        InvalidInputError, match="ring must have other identifiers than thumb on the same bus, but both have 0x3"
    ):
        dispatch.attach(Told("ring", {21}, {3}))


def test_a_request_that_another_device_hears_as_its_own_is_refused(dispatch: FrameDispatch) -> None:
    with pytest.raises(
        InvalidInputError, match="ring must have other identifiers than thumb on the same bus, but both have 0x3"
    ):
        dispatch.attach(Told("ring", {3}, {21}))
