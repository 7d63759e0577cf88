"""The CAN devices of a scenario, which are opened, tared, recorded and closed together."""

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

# Options of python-can's buses that are set here, by their new and old names; a filter would hide drivers' frames.
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
_GREETING_TIME = 5.0  # s within which a device must give its first sample to be tared; Barrett's hand needs 1 s to wake


def live_buses(senses: CanSenses) -> dict[str, DeviceBus]:
    """Creates the buses of a scenario without opening them.

    Raises:
        InvalidInputError: if python-can lacks an interface, an option is not allowed, or a name is not usable for a
            log file.
    """
    buses = {}
    for name, bus in senses.buses.items():
        if not re.fullmatch(r"\w[\w .-]{0,59}", name):
            raise InvalidInputError(
                "CanSenses.buses must have names that can name a log, of up to 60 letters, digits, '_', '-', '.' and "
                f"spaces, the first of which is a letter, a digit or '_', not {name!r}."
            )
        with told_of(f"CanSenses.buses[{name}]."):
            _check_options(bus.options)
            buses[name] = DeviceBus.open(bus.interface, bus.channel, **bus.options)
            buses[name].name = f"bus {name!r}, {bus.channel!r} of {bus.interface}"
    return buses


def _check_options(options: Iterable[str]) -> None:
    for option in options:
        if option in _NO_OPTIONS:
            raise InvalidInputError(f"options must be the interface's own, such as bitrate, not {option!r}.")


def check_drivers(senses: CanSenses) -> None:
    """Creates all drivers and attaches them to their buses, without opening these.

    Raises:
        InvalidInputError: if a driver's argument is out of its range, python-can lacks an interface, or two devices on
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
    """Buses that replay logs in virtual time.

    Raises:
        InvalidFileError: if a log cannot be read.
    """
    return {name: open_log(path) for name, path in logs.items()}


class CanDevices:
    """The devices of a scenario on its buses; a context manager.

    Attributes:
        buses: the buses by name.
        boards: the force-torque boards by finger.
        hand: Barrett's hand, or None.
        recorders: the recorders of buses that are recorded; empty until the buses are open.
    """

    def __init__(
        self, senses: CanSenses, buses: Mapping[str, DeviceBus], logs: Mapping[str, Path] | None = None
    ) -> None:
        """Creates the drivers; `__enter__` opens the buses.

        Args:
            senses: the devices' configuration, already validated.
            buses: a bus for each name in `senses.buses`, not open yet.
            logs: files to record buses to, by name; existing ones are replaced. None: nothing is recorded.

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
        """Opens the buses and starts the devices.

        Raises:
            BusError: if a bus cannot be opened.
            InvalidFileError: if a log cannot be written.
        """
        with contextlib.ExitStack() as parts:
            # Recorders are entered first, so that they close after the buses, whose threads write to them.
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
        """Tares every sensor; nothing may touch the hand meanwhile.

        Args:
            samples: number of samples of each board to average; Barrett's arrays tare themselves.

        Raises:
            DeviceTimeoutError: if a device does not answer.
            DeviceError: if a device's samples are not valid, or a tactile array is missing.
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
        """Gauge readings without load, as tared, shape (6,), by finger."""
        return {finger: board.bias for finger, board in self.boards.items()}

    def set_biases(self, biases: Mapping[str, ArrayLike]) -> None:
        """Sets the gauge readings without load, as from `biases`."""
        for finger, gauges in biases.items():
            self.boards[finger].bias = gauges

    def start(self, origin: float | None = None) -> float:
        """Sets the time that is 0 in a diagram.

        Args:
            origin: time since the epoch, s; None: the current time of the first bus's clock.

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
        # Checked here because the driver's argument has another name.
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
