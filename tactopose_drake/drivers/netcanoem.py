"""The driver of ATI's NETCANOEM board: a six-axis force-torque transducer on CAN.

Not tested on hardware: written from the manual and from what public drivers agree on (`netcanoem_protocol.py`).
"""

import dataclasses
from collections.abc import Generator

import can
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.validation import FloatArray, finite_array, positive_number, whole_number
from tactopose_drake.drivers import netcanoem_protocol as protocol
from tactopose_drake.drivers.device import OK, Conversation, Device, Exchange, Pause
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.netcanoem_protocol import Firmware, ForceUnit, Opcode, StatusBit, TorqueUnit
from tactopose_drake.errors import DeviceError, DeviceTimeoutError, ProtocolError

# Counts per unit of force and torque of boards that do not report them (firmware before 3.7). [A]
_OLD_COUNTS = (1_000_000, 1_000_000)


@dataclasses.dataclass(frozen=True, eq=False)
class ForceTorqueSample:
    """One sample of a force-torque board.

    Attributes:
        time: arrival of its last frame, s since the epoch.
        F_S: wrench on the transducer [m_x, m_y, m_z, f_x, f_y, f_z] about the origin of its frame S, in S, N m and N,
            shape (6,); NaN unless the status is "ok", with or without warnings.
        gauges: readings of the strain gauges before the bias is subtracted, shape (6,); zeros after a bad reply.
        status: "ok"; "ok (...)" with warnings; "saturated: " and the gauges, from 0; "error: " and the status bits; or
            "bad reply: " and the reason.
    """

    time: float
    F_S: FloatArray
    gauges: NDArray[np.int64]
    status: str


@dataclasses.dataclass(frozen=True, eq=False)
class BoardCalibration:
    """The calibration that converts gauge readings to a wrench.

    Attributes:
        matrix: the board's matrix, rows F_x, F_y, F_z, T_x, T_y, T_z, in counts, shape (6, 6).
        counts_per_force: counts per unit of force.
        counts_per_torque: counts per unit of torque.
        force_unit: unit of force.
        torque_unit: unit of torque.
    """

    matrix: FloatArray
    counts_per_force: int
    counts_per_torque: int
    force_unit: ForceUnit
    torque_unit: TorqueUnit

    def wrench_matrix(self) -> FloatArray:
        """A with F_S = A @ (gauges - bias): rows m_x, m_y, m_z, f_x, f_y, f_z, N m and N per reading, shape (6, 6)."""
        force = self.matrix[:3] * (self.force_unit.newtons / self.counts_per_force)
        torque = self.matrix[3:] * (self.torque_unit.newton_meters / self.counts_per_torque)
        return np.concatenate([torque, force])


class NetCanOemForceTorque(Device[ForceTorqueSample]):
    """A NETCANOEM board: the driver reads its calibration, polls it, and subtracts the bias.

    If an answer is missing, or a sample says that the watchdog has reset the board, the board may have restarted with
    calibration 0. It is then set up again, which activates the calibration, before further samples are used.

    Attributes:
        firmware: the board's firmware version; None until it has answered.
        calibration: the board's calibration; None until it has answered.
    """

    def __init__(
        self,
        bus: DeviceBus,
        base: int = 0x20,
        *,
        calibration_slot: int = 0,
        period: float = 0.005,
        units: tuple[ForceUnit, TorqueUnit] | None = None,
        timeout: float = 0.1,
        name: str = "",
    ) -> None:
        """Prepares the driver, which uses the bus while it is entered as a context manager.

        Args:
            bus: the bus that the board is on.
            base: base of the board's identifiers, 0 to 127.
            calibration_slot: calibration to activate, 0 to 15.
            period: time between two samples, s.
            units: units of the calibration, required for boards that do not report them (firmware before 3.7).
            timeout: maximum wait for an answer, s.
            name: the board's name in messages.

        Raises:
            InvalidInputError: if a number is out of its range.
        """
        base = whole_number("base", base, least=0, most=protocol.BASES - 1)
        calibration_slot = whole_number("calibration_slot", calibration_slot, least=0, most=protocol.CALIBRATIONS - 1)
        identifiers = frozenset(protocol.identifier(base, opcode) for opcode in range(16))
        super().__init__(bus, name or f"force-torque board {base:#x}", requests=identifiers, replies=identifiers)
        self._base, self._slot, self._units = base, calibration_slot, units
        self._period, self._timeout = positive_number("period", period), positive_number("timeout", timeout)
        self._bias = np.zeros(6)
        self.firmware: Firmware | None = None
        self.calibration: BoardCalibration | None = None
        self._answered_at = 0.0
        self._tells_reset = False  # whether the newest sample has the bit of a watchdog reset
        self._answers: dict[int, bytes] = {}  # of the present setup, by identifier

    @property
    def bias(self) -> FloatArray:
        """Gauge readings without a load, shape (6,)."""
        return self._bias.copy()

    @bias.setter
    def bias(self, gauges: ArrayLike) -> None:
        self._bias = finite_array("bias", gauges, (6,))

    def tare(self, samples: int = 50, timeout: float = 2.0) -> FloatArray:
        """Makes the present load the zero: sets the bias to the mean of the next gauge readings. Drops unread samples.

        Args:
            samples: number of samples.
            timeout: maximum wait for each, s.

        Returns:
            The bias, shape (6,).

        Raises:
            DeviceTimeoutError: if a sample does not arrive in time.
            DeviceError: if a sample is invalid; the bias is then unchanged.
            InvalidInputError: if an argument is out of its range.
        """
        samples = whole_number("samples", samples, least=1)
        self._unread.clear()
        gauges: list[NDArray[np.int64]] = []
        while len(gauges) < samples:
            sample = self.read(timeout)
            if not np.isfinite(sample.F_S).all():
                raise DeviceError(f"{self.name} cannot be tared; its status is {sample.status}.")
            gauges.append(sample.gauges)
        self.bias = np.mean(gauges, axis=0)
        return self.bias

    def _converse(self) -> Conversation:
        # A request to activate a calibration and its answer are equal frames. Therefore, the firmware version is
        # requested first: if that request comes back, too, the bus echoes requests, and the second of the two frames is
        # the answer about the calibration.
        self._answers.clear()
        (version,), echoed = yield from self._ask(Opcode.FIRMWARE)
        self.firmware = protocol.decode_firmware(version)
        yield from self._activate(echoed)
        matrix = np.empty((6, 6))
        for axis in range(6):
            replies, _ = yield from self._ask(Opcode.MATRIX, bytes([axis]), parts=3)
            matrix[axis] = protocol.decode_matrix_row(replies)
        if np.linalg.matrix_rank(matrix) < 6:
            raise DeviceError(f"{self.name}: calibration {self._slot} is empty: its matrix has no inverse.")
        counts, units = _OLD_COUNTS, self._units
        if self.firmware.tells_units:
            counts = protocol.decode_counts((yield from self._ask(Opcode.COUNTS))[0][0])
            units = protocol.decode_units((yield from self._ask(Opcode.UNITS))[0][0])
        # A second, contradicting reply to the last request has arrived when this one is answered.
        if (yield from self._ask(Opcode.FIRMWARE))[0] != [version]:
            raise ProtocolError("firmware version came twice, with different data.")
        self._answers.clear()
        if units is None:
            raise DeviceError(
                f"{self.name}: firmware {self.firmware.major}.{self.firmware.minor} does not report its units. Set the "
                "argument `units`."
            )
        self.calibration = BoardCalibration(matrix, *counts, *units)
        to_wrench = self.calibration.wrench_matrix()
        ask_at = self._now
        self._tells_reset = True  # A reset before the setup does no harm.
        while True:
            yield from self._sample(to_wrench)
            # Relative to the due time, so that delays do not lower the rate.
            ask_at = max(ask_at + self._period, self._now)
            yield Exchange((), self._contradicted, ask_at - self._now)

    def _activate(self, echoed: bool) -> Conversation:
        frame = data_frame(protocol.identifier(self._base, Opcode.CALIBRATION), protocol.encode_calibration(self._slot))
        answers: list[bytes] = []

        def collect(reply: can.Message) -> bool:
            self._compare(reply)
            if reply.arbitration_id == frame.arbitration_id:
                answers.append(bytes(reply.data))
            return len(answers) > echoed

        if not (yield Exchange((frame,), collect, self._timeout)):
            raise self._silence("calibration")
        for answer in answers:
            if protocol.decode_calibration(answer) != self._slot:
                raise DeviceError(
                    f"{self.name} activated calibration {protocol.decode_calibration(answer)} instead of {self._slot}."
                )
        self._answers[frame.arbitration_id] = answers[0]

    def _ask(
        self, opcode: Opcode, data: bytes = b"", parts: int = 1
    ) -> Generator[Exchange | Pause, bool, tuple[list[bytes], bool]]:
        """Sends a request whose answer differs from it.

        Returns:
            The answer's frames, and whether the request itself came back.

        Raises:
            ProtocolError: if one of the answer's frames comes twice, with different data.
            DeviceTimeoutError: if the answer does not arrive in time.
        """
        request = data_frame(protocol.identifier(self._base, opcode), data)
        replies: list[bytes] = []
        echoed = False
        for part in range(parts):
            self._answers.pop(request.arbitration_id + part, None)

        def collect(frame: can.Message) -> bool:
            nonlocal echoed
            reply, part = bytes(frame.data), frame.arbitration_id - request.arbitration_id
            self._compare(frame)
            if part == 0 and reply == data:
                echoed = True
            elif part == len(replies):
                replies.append(reply)
                self._answered_at = frame.timestamp
            elif 0 <= part < len(replies) and reply != replies[part]:
                raise ProtocolError(f"reply to {opcode.name.lower()}: part {part} came twice, with different data.")
            return len(replies) == parts

        if not (yield Exchange((request,), collect, self._timeout)):
            raise self._silence(opcode.name.lower())
        self._answers.update((request.arbitration_id + part, reply) for part, reply in enumerate(replies))
        return replies, echoed

    def _compare(self, frame: can.Message) -> None:
        """Raises ProtocolError if a frame contradicts an answer of the present setup."""
        if self._answers.get(frame.arbitration_id, frame.data) != frame.data:
            raise ProtocolError(f"reply with the identifier {frame.arbitration_id:#x} came twice, with different data.")

    def _contradicted(self, frame: can.Message) -> bool:
        """Compares frames between two samples, as from a second board of the same identifiers; always False."""
        self._compare(frame)
        return False

    def _sample(self, to_wrench: FloatArray) -> Conversation:
        try:
            (first, second), _ = yield from self._ask(Opcode.SAMPLE, parts=2)
            word, gauges = protocol.decode_sample(first, second)
        except ProtocolError as error:
            nothing, status = np.full(6, np.nan), f"bad reply: {str(error).removesuffix('.')}"
            self._publish(ForceTorqueSample(self._now, nothing, np.zeros(6, np.int64), status))
            return
        before, self._tells_reset = self._tells_reset, bool(word & StatusBit.WATCHDOG_RESET)
        if self._tells_reset and not before:
            raise DeviceError(f"{self.name} was reset by its watchdog, and must be set up again.")
        status = _status(word, gauges)
        F_S = to_wrench @ (np.array(gauges) - self._bias) if status.startswith(OK) else np.full(6, np.nan)
        self._publish(ForceTorqueSample(self._answered_at, F_S, np.array(gauges, dtype=np.int64), status))

    def _silence(self, request: str) -> DeviceTimeoutError:
        return DeviceTimeoutError(f"no reply to the request for its {request} within {self._timeout:g} s")


def _status(word: int, gauges: list[int]) -> str:
    if protocol.is_rejected(word):
        return "error: " + ", ".join(protocol.status_names(word))
    ends = [str(k) for k, gauge in enumerate(gauges) if gauge in protocol.GAUGE_LIMITS]
    if ends:
        return "saturated: gauge " + ", ".join(ends)
    return f"{OK} ({', '.join(protocol.status_names(word))})" if word else OK
