"""A simulated NETCANOEM board with given wrenches."""

from collections.abc import Callable, Mapping

import can
import numpy as np
from numpy.typing import ArrayLike

from tactopose_drake.drivers import netcanoem_protocol as protocol
from tactopose_drake.drivers.frames import data_frame
from tactopose_drake.drivers.netcanoem import BoardCalibration
from tactopose_drake.drivers.netcanoem_protocol import Firmware, ForceUnit, Opcode, StatusBit, TorqueUnit
from tactopose_drake.drivers.simulation.simulated_device import SimulatedDevice

DEFAULT_FIRMWARE = Firmware(3, 8, 1)


def nano17_like_calibration(generator: np.random.Generator) -> BoardCalibration:
    """A calibration like that of a Nano17, SI-12-0.12: a full scale of about 12 N and 0.12 N m.

    Args:
        generator: draws the coupling of the gauges, which differs between transducers.
    """
    # The six gauges measure combinations of six loads; orthogonal rows make the matrix well-conditioned.
    coupling = np.linalg.qr(generator.normal(size=(6, 6)))[0]
    full_scale = np.array([12.0, 12.0, 17.0, 120.0, 120.0, 120.0])  # N, N mm
    counts = np.array([1e6] * 6)
    # Full scale on one axis uses a quarter of the gauges' range, so that loads on several axes do not saturate them.
    matrix = (full_scale * counts / 8000.0)[:, None] * coupling
    matrix = matrix.astype(np.float32).astype(np.float64)  # as transmitted
    return BoardCalibration(matrix, 1_000_000, 1_000_000, ForceUnit.NEWTON, TorqueUnit.NEWTON_MILLIMETER)


class SimulatedNetCanOem(SimulatedDevice):
    """A NETCANOEM board with a transducer.

    Attributes:
        status: bits of the status word, to which the board adds its own.
        broken_gauges: constant readings of broken gauges, by gauge.
        active: slot of the active calibration, 0 after power-up.
    """

    def __init__(
        self,
        wrench: Callable[[float], ArrayLike],
        calibrations: Mapping[int, BoardCalibration],
        base: int = 0x20,
        *,
        offset: ArrayLike = (0, 0, 0, 0, 0, 0),
        firmware: Firmware = DEFAULT_FIRMWARE,
    ) -> None:
        """Keeps its arguments.

        Args:
            wrench: the load F_S = [m_x, m_y, m_z, f_x, f_y, f_z] at a time in s since the epoch, shape (6,), N m and N;
                NaN for a load beyond the transducer's range.
            calibrations: the calibrations by slot.
            base: base of the board's identifiers.
            offset: gauge readings without a load, shape (6,).
            firmware: the firmware version.
        """
        super().__init__()
        self._wrench, self._calibrations, self._base = wrench, calibrations, base
        self._to_gauges = {slot: np.linalg.inv(each.wrench_matrix()) for slot, each in calibrations.items()}
        self._offset, self._firmware = np.asarray(offset, dtype=np.float64), firmware
        self.status = StatusBit(0)
        self.broken_gauges: dict[int, int] = {}
        self.active = 0

    def _answer(self, arbitration_id: int, data: bytes, time: float) -> list[can.Message] | None:
        if arbitration_id >> 4 != self._base:
            return None
        opcode = arbitration_id & 0xF
        calibration = self._calibrations.get(self.active)
        match opcode, len(data):
            case Opcode.SAMPLE, 0:
                answer = list(protocol.encode_sample(self._status_word(), self._gauges(time)))
            case Opcode.MATRIX, 1 if data[0] < 6:
                row = np.zeros(6) if calibration is None else calibration.matrix[data[0]]
                answer = protocol.encode_matrix_row(row)
            case Opcode.CALIBRATION, 1 if data[0] < protocol.CALIBRATIONS:
                self.active = data[0]
                answer = [data]
            case Opcode.FIRMWARE, 0:
                answer = [protocol.encode_firmware(self._firmware)]
            case Opcode.COUNTS, 0 if self._firmware.tells_units and calibration is not None:
                answer = [protocol.encode_counts(calibration.counts_per_force, calibration.counts_per_torque)]
            case Opcode.UNITS, 0 if self._firmware.tells_units and calibration is not None:
                answer = [protocol.encode_units(calibration.force_unit, calibration.torque_unit)]
            case _:
                return None
        return [data_frame(arbitration_id + part, reply) for part, reply in enumerate(answer)]

    def _forget(self) -> None:
        self.active = 0

    def _status_word(self) -> int:
        word = self.status if self.active in self._calibrations else self.status | StatusBit.BAD_CALIBRATION
        return word | StatusBit.ANY_ERROR if word else word

    def _gauges(self, time: float) -> list[int]:
        readings = np.array(self._offset)
        if self.active in self._to_gauges:
            readings += self._to_gauges[self.active] @ np.asarray(self._wrench(time), dtype=np.float64)
        low, high = protocol.GAUGE_LIMITS
        gauges: list[int] = np.nan_to_num(np.clip(np.rint(readings), low, high), nan=high).astype(int).tolist()
        for gauge, reading in self.broken_gauges.items():
            gauges[gauge] = reading
        return gauges
