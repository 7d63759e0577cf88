"""Senses of a scenario that come from devices on CAN buses, and what else such a run is told; only data."""

import dataclasses
import os

from tactopose_drake.core.validation import positive_number, whole_number
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tactopose_drake.hand.hand_config import HandConfig


@dataclasses.dataclass(kw_only=True, slots=True)
class CanBus:
    """A bus, as python-can names it."""

    interface: str = "socketcan"  # as python-can names it
    channel: str = "can0"  # of that interface
    # The interface's own, such as bitrate.
    options: dict[str, str | bool | int | float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(kw_only=True, slots=True)
class ForceTorqueBoard:
    """An ATI NETCANOEM board with the transducer of one finger."""

    bus: str = ""  # a name of `CanSenses.buses`
    base: int = 0x20  # of its identifiers
    calibration: int = 0  # slot, 0 to 15
    period: float = 0.005  # between two samples, s
    timeout: float = 0.1  # longest wait for an answer, s
    max_age: float = 0.05  # of a sample that counts, s
    force_unit: str = ""  # name of `netcanoem_protocol.ForceUnit`, for boards that do not tell: firmware before 3.7
    torque_unit: str = ""  # of `TorqueUnit`; likewise


@dataclasses.dataclass(kw_only=True, slots=True)
class BarrettPucks:
    """A Barrett BH8-280 hand: its joints and tactile arrays, which are the hand's pads of the same names."""

    bus: str = ""  # a name of `CanSenses.buses`
    mode: str = "FULL"  # of the tactile arrays: FULL or TOP
    period: float = 0.025  # between two rounds, s
    timeout: float = 0.1  # longest wait for the answers of a round, s
    max_age: float = 0.15  # of a sample that counts, s
    strain_polynomials: list[list[float]] = dataclasses.field(default_factory=list)  # of F1 to F3; empty: a default
    # The model's joint of each of `barrett_joints.JOINTS`.
    joints: list[str] = dataclasses.field(
        default_factory=lambda: [
            *(f"finger_{k}_proximal_joint" for k in (1, 2, 3)),
            *(f"finger_{k}_distal_joint" for k in (1, 2, 3)),
            "finger_1_spread_joint",
        ]
    )


@dataclasses.dataclass(kw_only=True, slots=True)
class JointPort:
    """Joint positions come through the diagram's input port `joint_positions`, `!JointPort` in YAML."""


@dataclasses.dataclass(kw_only=True, slots=True)
class FixedJoints:
    """Joints that do not move, `!FixedJoints` in YAML."""

    positions: dict[str, float] = dataclasses.field(default_factory=dict)  # rad; others follow their leader, or are 0


@dataclasses.dataclass(kw_only=True, slots=True)
class JointFile:
    """Joint positions over time, `!JointFile` in YAML."""

    # CSV: a header of `time` and joints' names, then rows of s and rad until the run ends; others follow, or are 0.
    # In a gap, as one of `palm`, they are not known
    path: str = ""


@dataclasses.dataclass(kw_only=True, slots=True)
class SimulatedDevices:
    """Simulated devices at the other end of the buses, so that all can be tried without hardware.

    They feel what the scenario's simulated hand felt in a grasp that is computed before, or what is in a folder of CSV
    files: `<finger>.csv` with a header, then rows of a time in s and the wrench on the fingertip [m_x, m_y, m_z, f_x,
    f_y, f_z], N m and N; `hand.csv` with a time and the 106 numbers of `HandState.from_row` for Barrett's hand.
    """

    folder: str = ""  # of CSV files; empty: the simulated hand


@dataclasses.dataclass(kw_only=True, slots=True)
class CanSenses:
    """Devices on CAN buses, `!CanSenses` in YAML."""

    buses: dict[str, CanBus] = dataclasses.field(default_factory=dict)
    fingers: dict[str, ForceTorqueBoard] = dataclasses.field(default_factory=dict)  # by the hand's names
    barrett_hand: BarrettPucks | None = None
    # Where the joint angles come from, unless from Barrett's hand or from the simulated one.
    joints: JointPort | FixedJoints | JointFile = dataclasses.field(default_factory=JointPort)
    prior: str = ""  # a prior.yaml with the object's pose by other means; empty: the diagram's input port `prior`
    # CSV of where an arm holds the palm in the world, whose z points up: a header of `time, x, y, z, qw, qx, qy, qz`,
    # then rows of s, m, and a unit quaternion until the run ends, each of which holds until the next; in a gap that is
    # longer than 0.15 s and ten usual steps it is not known; empty: the diagram's input port `palm_pose`, or a base
    # that stands still
    palm: str = ""
    tare_samples: int = 50  # of each board before the start, while nothing touches the hand; 0: no tare
    compensate_weight: bool = True  # whether a fingertip's weight is followed as the fingertip turns after the tare
    simulated: SimulatedDevices | None = None  # None: the devices are real

    def validate(self, hand: HandConfig) -> None:
        """Raises InvalidInputError if a value is out of its range or a name leads nowhere; devices check their own."""
        if not self.fingers and self.barrett_hand is None:
            raise InvalidInputError("CanSenses: has neither fingers nor barrett_hand; allowed are one or both.")
        whole_number("CanSenses.tare_samples", self.tare_samples, least=0)
        self._check_buses()
        sensing = [finger.name for finger in hand.fingers if finger.sensor_frame]
        for name, board in self.fingers.items():
            if name not in sensing:
                raise UnknownNameError("CanSenses.fingers", name, sensing)
            self._check_device(f"CanSenses.fingers[{name}]", board)
        if self.barrett_hand is not None:
            self._check_device("CanSenses.barrett_hand", self.barrett_hand)
            if not isinstance(self.joints, JointPort):
                raise InvalidInputError(
                    "CanSenses.joints: is given, but Barrett's hand measures its own; allowed is none."
                )
        if self.palm and self.simulated == SimulatedDevices():
            raise InvalidInputError(
                "CanSenses.palm: is given, but the base of the hand that the simulated devices feel with stands still; "
                "allowed is none, or simulated devices with a folder."
            )
        joints = self.joints.path if isinstance(self.joints, JointFile) else ""
        if isinstance(self.joints, JointFile) and not joints:
            raise InvalidInputError("CanSenses.joints.path: is not given; allowed is a CSV file of joint positions.")
        for key, path in {"prior": self.prior, "palm": self.palm, "joints.path": joints}.items():
            if path and not os.path.isfile(path):
                raise InvalidInputError(f"CanSenses.{key}: there is no file {path}.")
        if self.simulated is not None and self.simulated.folder and not os.path.isdir(self.simulated.folder):
            raise InvalidInputError(f"CanSenses.simulated.folder: there is no folder {self.simulated.folder}.")

    def _check_buses(self) -> None:
        """Two buses on one channel would hear each other's devices."""
        names: dict[tuple[str, str], str] = {}
        for name, bus in self.buses.items():
            first = names.setdefault((bus.interface, bus.channel), name)
            if first != name:
                raise InvalidInputError(
                    f"CanSenses.buses[{name}]: is on {bus.interface} {bus.channel!r}, as is {first}; allowed is one "
                    "bus for each channel."
                )

    def _check_device(self, name: str, device: ForceTorqueBoard | BarrettPucks) -> None:
        if device.bus not in self.buses:
            raise UnknownNameError(f"{name}.bus", device.bus, self.buses)
        for what in ("period", "timeout", "max_age"):
            positive_number(f"{name}.{what}", getattr(device, what))
        if device.max_age < device.period:
            raise InvalidInputError(
                f"{name}.max_age: is {device.max_age:g} s; allowed are its period, {device.period:g} s, and more."
            )
