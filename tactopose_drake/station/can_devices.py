"""The CAN devices that a scenario names: opened together, tared, recorded, and closed together."""

import contextlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Self

from numpy.typing import ArrayLike

from tactopose_drake.core.validation import FloatArray, known_name, told_of, whole_number
from tactopose_drake.drivers.barrett_hand import BarrettHand
from tactopose_drake.drivers.barrett_joints import STRAIN_POLYNOMIAL
from tactopose_drake.drivers.barrett_protocol import TactileMode
from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.netcanoem import NetCanOemForceTorque
from tactopose_drake.drivers.netcanoem_protocol import CALIBRATIONS, ForceUnit, TorqueUnit
from tactopose_drake.drivers.replay_bus import open_log
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.station.can_senses import BarrettPucks, CanSenses, ForceTorqueBoard

# What python-can's buses are opened with in any case, by its new names and old; a filter would hide drivers' frames.
_NO_OPTIONS = (
    "interface",
    "channel",
    "ignore_config",
    "config_context",
    "bustype",
    "context",
    "can_filters",
    "cls",
    "self",
)
_GREETING_TIME = 5.0  # s, in which a device must have given its first sample to be tared; Barrett's wakes up for 1 s


def live_buses(senses: CanSenses) -> dict[str, DeviceBus]:
    """The buses of a scenario, not open yet.

    Raises:
        InvalidInputError: if python-can has no such interface, an option is none that an interface has, or a name is
            none that a log can have.
    """
    buses = {}
    for name, bus in senses.buses.items():
        if not re.fullmatch(r"\w[\w .-]{0,59}", name):
            raise InvalidInputError(
                f"CanSenses.buses: has the name {name!r}, which its log would have too; allowed are up to 60 letters, "
                "digits, '_', '-', '.' and spaces, the first of which is a letter, a digit or '_'."
            )
        with told_of(f"CanSenses.buses[{name}]."):
            _check_options(bus.options)
            buses[name] = DeviceBus.open(bus.interface, bus.channel, **bus.options)
            buses[name].name = f"bus {name!r}, {bus.channel!r} of {bus.interface}"
    return buses


def _check_options(options: Iterable[str]) -> None:
    for option in options:
        if option in _NO_OPTIONS:
            raise InvalidInputError(f"options: has {option!r}; allowed are the interface's own, such as bitrate.")


def check_drivers(senses: CanSenses) -> None:
    """Makes all drivers and lets them share their buses, none of which is opened.

    Raises:
        InvalidInputError: if a driver's argument is out of its range, python-can lacks an interface, or two devices of
            a bus have the same identifiers; the message names the finger or the bus.
    """
    devices = CanDevices(senses, live_buses(senses))
    for finger, board in senses.fingers.items():
        with told_of(f"CanSenses.buses[{board.bus}]: "):
            devices.buses[board.bus].attach(devices.boards[finger])
    if senses.barrett_hand is not None and devices.hand is not None:
        with told_of(f"CanSenses.buses[{senses.barrett_hand.bus}]: "):
            devices.buses[senses.barrett_hand.bus].attach(devices.hand)


def logged_buses(logs: Mapping[str, Path]) -> dict[str, DeviceBus]:
    """Buses that play logs, in virtual time.

    Raises:
        InvalidFileError: if a log cannot be read.
    """
    return {name: open_log(path) for name, path in logs.items()}


class CanDevices:
    """The devices of a scenario on its buses; a context manager.

    Attributes:
        buses: by name.
        boards: force-torque boards by finger.
        hand: Barrett's hand, or None.
        recorders: of the buses that are recorded, once they are open.
    """

    def __init__(
        self, senses: CanSenses, buses: Mapping[str, DeviceBus], logs: Mapping[str, Path] | None = None
    ) -> None:
        """Prepares the drivers; `__enter__` opens the buses.

        Args:
            senses: which devices; valid.
            buses: one for each name in `senses.buses`, not open yet.
            logs: where to record each bus; existing files are replaced. Nothing is recorded without.

        Raises:
            InvalidInputError: if a driver's argument is out of its range, or two devices have the same identifiers.
        """
        self.buses = dict(buses)
        self._senses, self._logs = senses, dict(logs or {})
        self._parts = contextlib.ExitStack()
        self.recorders: list[CanRecorder] = []
        self.boards = {
            finger: _make_board(finger, board, self.buses[board.bus]) for finger, board in senses.fingers.items()
        }
        pucks = senses.barrett_hand
        self.hand = None if pucks is None else _make_hand(pucks, self.buses[pucks.bus])

    def __enter__(self) -> Self:
        """Opens the buses, and lets the devices take part.

        Raises:
            BusError: if a bus cannot be opened.
            InvalidFileError: if a log cannot be written.
        """
        with contextlib.ExitStack() as parts:
            # The recorders last: they must outlive their buses, whose threads write to them.
            for name, path in self._logs.items():
                parts.enter_context(recorder := CanRecorder(path))
                self.recorders.append(recorder)
                recorder.record(self.buses[name])
            for bus in self.buses.values():
                parts.enter_context(bus)
            for board in self.boards.values():
                parts.enter_context(board)
            if self.hand is not None:
                parts.enter_context(self.hand)
            self._parts = parts.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._parts.close()

    def tare(self, samples: int) -> None:
        """Makes the present load of every sensor the zero; nothing may touch the hand meanwhile.

        Args:
            samples: of each board; Barrett's arrays tare themselves.

        Raises:
            DeviceTimeoutError: if a device does not answer.
            DeviceError: if a device's samples are not valid, or a tactile array is not there to be tared.
        """
        for board in self.boards.values():
            board.read(_GREETING_TIME)
        for board in self.boards.values():
            board.tare(samples)
        if self.hand is not None:
            self.hand.read(_GREETING_TIME)
            self.hand.tare()

    @property
    def biases(self) -> dict[str, FloatArray]:
        """Gauge readings that count as no load, shape (6,), by finger."""
        return {finger: board.bias for finger, board in self.boards.items()}

    def set_biases(self, biases: Mapping[str, ArrayLike]) -> None:
        """Sets what `biases` gives."""
        for finger, gauges in biases.items():
            self.boards[finger].bias = gauges

    def start(self, origin: float | None = None) -> float:
        """Makes this the time 0 of a diagram.

        Args:
            origin: s since the epoch; what the first bus's clock shows now, if not given.

        Returns:
            The origin.
        """
        origin = next(iter(self.buses.values())).clock.time() if origin is None else origin
        for bus in self.buses.values():
            bus.origin = origin
        return origin


def _make_board(finger: str, board: ForceTorqueBoard, bus: DeviceBus) -> NetCanOemForceTorque:
    with told_of(f"CanSenses.fingers[{finger}]."):
        units = None
        if board.force_unit or board.torque_unit:
            for name, unit, known in (
                ("force_unit", board.force_unit, ForceUnit),
                ("torque_unit", board.torque_unit, TorqueUnit),
            ):
                known_name(name, unit, known.__members__)
            units = ForceUnit[board.force_unit], TorqueUnit[board.torque_unit]
        # The driver calls it otherwise.
        whole_number("calibration", board.calibration, least=0, most=CALIBRATIONS - 1)
        return NetCanOemForceTorque(
            bus,
            board.base,
            calibration_slot=board.calibration,
            period=board.period,
            timeout=board.timeout,
            units=units,
            name=finger,
        )


def _make_hand(pucks: BarrettPucks, bus: DeviceBus) -> BarrettHand:
    with told_of("CanSenses.barrett_hand."):
        known_name("mode", pucks.mode, ("FULL", "TOP"))
        return BarrettHand(
            bus,
            mode=TactileMode[pucks.mode],
            period=pucks.period,
            timeout=pucks.timeout,
            strain_polynomials=pucks.strain_polynomials or (STRAIN_POLYNOMIAL,) * 3,
        )
