"""A driver that only listens to its device: one conversation, on a bus and on a log."""

import dataclasses
from pathlib import Path

import can
import pytest

from tactopose_drake.drivers import Conversation, Device, DeviceBus, Exchange, VirtualClock, data_frame, open_log
from tactopose_drake.drivers.log_frames import log_frames
from tactopose_drake.drivers.replay_bus import ReplayBus
from tactopose_drake.errors import DeviceTimeoutError, EndOfLogError, ProtocolError
from tests.drivers.rigs import START

IDENTIFIER = 0x300


@dataclasses.dataclass(frozen=True)
class Count:
    time: float
    status: str


class Counter(Device[Count]):
    """Gives a sample for each frame of one byte. After another frame, or none for 0.1 s, it begins anew."""

    def __init__(self, bus: DeviceBus) -> None:
        super().__init__(bus, "counter", requests=frozenset(), replies=frozenset({IDENTIFIER}))

    def _converse(self) -> Conversation:
        while True:
            frames: list[can.Message] = []

            def collect(frame: can.Message, frames: list[can.Message] = frames) -> bool:
                if len(frame.data) != 1:
                    raise ProtocolError("frame must have 1 byte.")
                frames.append(frame)
                return True

            if not (yield Exchange((), collect, 0.1)):
                raise DeviceTimeoutError("no frame within 0.1 s")
            self._publish(Count(frames[0].timestamp, f"ok ({frames[0].data[0]})"))


def write_log(path: Path) -> None:
    """Frames 10 ms apart, of which one is wrong, and a gap of half a second."""
    with can.BLFWriter(path) as log:
        for k in range(100):
            frame = data_frame(IDENTIFIER, bytes(2 if k == 20 else [k]))
            frame.timestamp, frame.channel, frame.is_rx = START + 0.01 * k + 0.5 * (k > 60), 0, True
            log.on_message_received(frame)


def samples(bus: DeviceBus) -> list[Count]:
    with bus, Counter(bus) as counter:
        with pytest.raises(EndOfLogError):
            bus.run_until(START + 10.0)
        return [counter.read(0.0) for _ in range(counter.samples)]


def test_a_replay_of_a_device_that_sends_by_itself_waits_as_long_as_on_a_bus(tmp_path: Path) -> None:
    path = tmp_path / "counter.blf"
    write_log(path)
    clock = VirtualClock(START)
    live = samples(DeviceBus(lambda: ReplayBus(log_frames(path), 0, clock), clock=clock, threaded=False))
    assert 90 < len(live) < 99  # all but the wrong frame and those that came in a pause
    assert samples(open_log(path)) == live
