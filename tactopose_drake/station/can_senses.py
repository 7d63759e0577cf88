"""Configuration of a scenario whose senses are devices on CAN buses; only data."""

import dataclasses
import os

from tactopose_drake.core.validation import known_name, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import HandConfig


@dataclasses.dataclass(kw_only=True, slots=True)
class CanBus:
    """A CAN bus."""

    interface: str = "socketcan"  # name of the interface in python-can
    channel: str = "can0"  # of that interface
    # Options of the interface, such as bitrate.
    options: dict[str, str | bool | int | float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(kw_only=True, slots=True)
class ForceTorqueBoard:
    """An ATI NETCANOEM board with the transducer of one finger."""

    bus: str = ""  # a name in `CanSenses.buses`
    base: int = 0x20  # base of its identifiers
    calibration: int = 0  # slot, 0 to 15
    period: float = 0.005  # between two samples, s
    timeout: float = 0.1  # longest wait for an answer, s
    max_age: float = 0.05  # age from which a sample is stale, s
    force_unit: str = ""  # name in `netcanoem_protocol.ForceUnit`, for boards that do not report it (firmware < 3.7)
    torque_unit: str = ""  # name in `TorqueUnit`; likewise


@dataclasses.dataclass(kw_only=True, slots=True)
class BarrettPucks:
    """A Barrett BH8-280 hand: its joints and tactile arrays, which are the hand's pads of the same names."""

    bus: str = ""  # a name in `CanSenses.buses`
    mode: str = "FULL"  # of the tactile arrays: FULL or TOP
    period: float = 0.025  # between two polls, s
    timeout: float = 0.1  # longest wait for the answers to a poll, s
    max_age: float = 0.15  # age from which a sample is stale, s
    strain_polynomials: list[list[float]] = dataclasses.field(default_factory=list)  # of F1 to F3; empty: a default
    # The model's joint for each of `barrett_joints.JOINTS`.
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

    positions: dict[str, float] = dataclasses.field(default_factory=dict)  # rad; other joints are coupled, or 0


@dataclasses.dataclass(kw_only=True, slots=True)
class JointFile:
    """Joint positions over time, `!JointFile` in YAML."""

    # CSV: a header of `time` and joints' names, then rows in s and rad until the run ends; other joints are coupled, or
    # 0. In a gap, as in `palm`, they are unknown.
    path: str = ""


@dataclasses.dataclass(kw_only=True, slots=True)
class SimulatedDevices:
    """Simulated devices at the other end of the buses, for tests without hardware.

    They replay the senses of the scenario's simulated hand in a grasp that is computed before, or a folder of CSV
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
    # Source of the joint positions, unless Barrett's hand or the simulated one gives them.
    joints: JointPort | FixedJoints | JointFile = dataclasses.field(default_factory=JointPort)
    prior: str = ""  # a prior.yaml with the object's pose from another source; empty: the diagram's input port `prior`
    # CSV of the palm's pose in the world, with z up, as an arm moves it: a header of `time, x, y, z, qw, qx, qy, qz`,
    # then rows in s, m, and a unit quaternion until the run ends; each holds until the next. In a gap that is longer
    # than 0.15 s and ten usual steps, the pose is unknown. Empty: the diagram's input port `palm_pose`, or a fixed
    # base.
    palm: str = ""
    tare_samples: int = 50  # samples of each board for the tare at the start, without a touch; 0: no tare
    compensate_weight: bool = True  # whether to compensate the fingertips' weight as they turn after the tare
    simulated: SimulatedDevices | None = None  # None: the devices are real

    def validate(self, hand: HandConfig) -> None:
        """Raises InvalidInputError if a value is out of its range or a name is unknown; drivers check their own."""
        if not self.fingers and self.barrett_hand is None:
            raise InvalidInputError("CanSenses must have fingers, barrett_hand or both, but has neither.")
        whole_number("CanSenses.tare_samples", self.tare_samples, least=0)
        self._check_buses()
        for name, board in self.fingers.items():
            known_name("each name in CanSenses.fingers", name, hand.sensing)
            self._check_device(f"CanSenses.fingers[{name}]", board)
        if self.barrett_hand is not None:
            self._check_device("CanSenses.barrett_hand", self.barrett_hand)
            if not isinstance(self.joints, JointPort):
                raise InvalidInputError("CanSenses.joints must be left out, as Barrett's hand measures its own.")
        if self.palm and self.simulated == SimulatedDevices():
            raise InvalidInputError(
                "CanSenses.palm must be left out, as the simulated devices replay a hand with a fixed base, unless "
                "they have a folder."
            )
        joints = self.joints.path if isinstance(self.joints, JointFile) else ""
        if isinstance(self.joints, JointFile) and not joints:
            raise InvalidInputError("CanSenses.joints.path must be a CSV file of joint positions, not empty.")
        for key, path in {"prior": self.prior, "palm": self.palm, "joints.path": joints}.items():
            if path and not os.path.isfile(path):
                raise InvalidInputError(f"CanSenses.{key}: there is no file {path}.")
        if self.simulated is not None and self.simulated.folder and not os.path.isdir(self.simulated.folder):
            raise InvalidInputError(f"CanSenses.simulated.folder: there is no folder {self.simulated.folder}.")

    def _check_buses(self) -> None:
        """Raises InvalidInputError if two buses are on one channel, where they would receive each other's frames."""
        names: dict[tuple[str, str], str] = {}
        for name, bus in self.buses.items():
            first = names.setdefault((bus.interface, bus.channel), name)
            if first != name:
                raise InvalidInputError(
                    f"CanSenses.buses[{name}] must have a channel of its own, not {bus.channel!r} of {bus.interface}, "
                    f"which {first} is on."
                )

    def _check_device(self, name: str, device: ForceTorqueBoard | BarrettPucks) -> None:
        known_name(f"{name}.bus", device.bus, self.buses)
        for what in ("period", "timeout", "max_age"):
            positive_number(f"{name}.{what}", getattr(device, what))
        if device.max_age < device.period:
            raise InvalidInputError(
                f"{name}.max_age must be at least its period, {device.period:g} s, not {device.max_age:g} s."
            )
