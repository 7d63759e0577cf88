"""The description of a hand in a `*.hand.yaml`."""

import dataclasses
from pathlib import Path

import numpy as np

from tactopose_drake.core.geometry_checks import points_near
from tactopose_drake.core.validation import (
    MOST_ALPHA,
    check_count,
    finite_array,
    instance_of,
    known_name,
    positive_number,
    told_of,
)
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError
from tactopose_drake.hand.calibration_file import load_calibration
from tactopose_drake.hand.fingertip_surfaces import (
    CapsuleSurface,
    EllipsoidSurface,
    SkinLayer,
    SphereSurface,
    SuperquadricSurface,
)
from tactopose_drake.resources import ModelPackage, load_typed_yaml, model_path, named_file


@dataclasses.dataclass(kw_only=True, slots=True)
class Coupling:
    """A joint without an actuator of its own: q_joint = ratio * q_follows + offset."""

    joint: str = ""  # the joint that follows
    follows: str = ""  # the actuated joint that it follows
    ratio: float = 1.0  # of their positions
    offset: float = 0.0  # position of the joint when the one that it follows is at 0, rad or m


_MOST_UNCERTAIN = {  # larger values must be in another unit, such as millimetres
    "encoder_offset_deg": (45.0, "deg"),
    "mounting": (0.05, "m"),
    "mounting_deg": (45.0, "deg"),
    "fingertip_radius": (0.05, "m"),
    "sensor_force": (10.0, "N"),
    "sensor_moment": (0.1, "N m"),
}


@dataclasses.dataclass(kw_only=True, slots=True)
class HandUncertainty:
    """Standard deviations of a hand's errors relative to its files; by default those of a good research hand."""

    encoder_offset_deg: float = 1.0  # of each measured joint's zero, deg; for a prismatic joint 1 deg stands for 1 mm
    mounting: float = 0.0003  # of each sensor's position on its finger, with its fingertip, along each axis, m
    mounting_deg: float = 0.5  # of its orientation, about each axis, deg; of an array about its cells' middle
    fingertip_radius: float = 0.0001  # of each fingertip's radius, m
    sensor_force: float = 0.05  # of each component of the force, bias and noise together, N
    sensor_moment: float = 0.0005  # of each component of the moment, bias and noise together, N m

    def validate(self) -> None:
        """Raises InvalidInputError if a value is below 0, not finite, or so large that it must be in another unit."""
        for field in dataclasses.fields(self):
            most, unit = _MOST_UNCERTAIN[field.name]
            name = f"HandUncertainty.{field.name}"
            positive_number(name, getattr(self, field.name), allow_zero=True, most=most, unit=unit)


@dataclasses.dataclass(kw_only=True, slots=True)
class FingerConfig:
    """One finger: the joints that move it and, if it has one, its force-torque sensor with the fingertip."""

    name: str = ""  # of the finger, used in the names of ports
    joints: list[str] = dataclasses.field(default_factory=list)  # actuated, from the palm outwards
    couplings: list[Coupling] = dataclasses.field(default_factory=list)  # the model must have them, too
    sensor_frame: str = ""  # S, the frame about and in which the wrench is measured; empty: there is no sensor
    # Joint between finger (parent) and fingertip (child), whose reaction the sensor measures: a fixed joint, or a
    # moving one if the sensor frame is fixed on the fingertip.
    weld: str = ""
    surface: SphereSurface | EllipsoidSurface | CapsuleSurface | SuperquadricSurface = dataclasses.field(
        default_factory=SphereSurface
    )
    layer: SkinLayer | None = None  # the soft skin on the fingertip, with `surface` as its outside; null: rigid
    # Whether its sensor is tared at each start, while nothing touches it. Biases found by a calibration are then
    # obsolete, and the biases are as uncertain as `uncertainty` says.
    tared: bool = False


@dataclasses.dataclass(kw_only=True, slots=True)
class PadConfig:
    """A tactile array and its soft pad."""

    name: str = ""  # of the pad, used in the names of ports
    frame: str = ""  # T, the frame of the array's layout: a frame or link of the model, on the pad's own body
    array: str = ""  # one of the package's tactile arrays by name, or a file by path, relative to the YAML file
    alpha: float = 0.0  # depth over pressure of the pad, m/Pa: its soft layer's thickness over its modulus


@dataclasses.dataclass(kw_only=True, slots=True)
class HandConfig:
    """A hand's model file and the names in it."""

    model: str = ""  # URL of an SDF, URDF or MJCF file, or its path relative to the YAML file
    packages: list[ModelPackage] = dataclasses.field(default_factory=list)  # other packages that the model's URLs name
    base_link: str = ""  # the link that carries the hand
    palm_frame: str = ""  # P, a frame or link of the model
    fingers: list[FingerConfig] = dataclasses.field(default_factory=list)
    pads: list[PadConfig] = dataclasses.field(default_factory=list)
    rest_positions: dict[str, float] = dataclasses.field(default_factory=dict)  # of actuated joints not at 0, rad or m
    grip_low: list[float] = dataclasses.field(default_factory=list)  # lower corner of the grip region in P, m
    grip_high: list[float] = dataclasses.field(default_factory=list)  # upper corner; both only for planned grasps
    # Uncertainty of all of this, from which the covariance of each contact and of each tactile array's pose is
    # computed. Null: that of contacts is given by the parameters of `ContactsInPalm`, that of arrays by those of
    # `PatchContact`.
    uncertainty: HandUncertainty | None = None
    # Path, relative to the YAML file, of a file by `tactopose calibrate` with the hand's known errors, which estimates
    # then correct. Empty: the hand is as its files say.
    calibration: str = ""

    def validate(self) -> None:
        """Checks everything that does not need the hand's model.

        Raises:
            InvalidInputError: if a part has a wrong type, a name is missing or duplicate, or a number is out of its
                range.
            UnknownNameError: if a coupling or a rest position is of a joint that the hand lacks.
        """
        if not self.model:
            raise InvalidInputError(
                "HandConfig.model must be the path of the hand's SDF, URDF or MJCF file, or its package:// URL, not "
                "empty."
            )
        for name, value in (("base_link", self.base_link), ("palm_frame", self.palm_frame)):
            if not value:
                raise InvalidInputError(f"HandConfig.{name} must be a name in the hand's model, not empty.")
        self._check_kinds()
        names = [finger.name for finger in self.fingers]
        if "" in names:
            raise InvalidInputError(f"HandConfig.fingers[{names.index('')}].name must be a name, not empty.")
        if not names or len(set(names)) < len(names):
            raise InvalidInputError(f"HandConfig.fingers must have different names, at least one, not {names}.")
        for finger in self.fingers:
            where = f"HandConfig.fingers[{finger.name}]"
            check_count(f"{where}.joints", len(finger.joints), "names")
            if len(set(finger.joints)) < len(finger.joints):
                raise InvalidInputError(f"{where}.joints must be different names, not {finger.joints}.")
            for coupling in finger.couplings:
                positive_number(f"coupling of {coupling.joint!r}: ratio", abs(coupling.ratio))
                finite_array(f"coupling of {coupling.joint!r}: offset", [coupling.offset], (1,))
                known_name(f"coupling of {coupling.joint!r}: follows", coupling.follows, finger.joints)
            if bool(finger.sensor_frame) != bool(finger.weld):
                given = "sensor_frame" if finger.sensor_frame else "weld"
                raise InvalidInputError(f"{where} must have both sensor_frame and weld, or neither, not {given} alone.")
            with told_of(f"{where}.surface."):
                surface = finger.surface.make()
            if finger.layer is not None:
                finger.layer.make(f"{where}.layer", surface)
        self._check_sensors()
        if self.uncertainty is not None:
            self.uncertainty.validate()
        pads = [pad.name for pad in self.pads]
        if "" in pads or len(set(pads)) < len(pads):
            raise InvalidInputError(f"HandConfig.pads must have different names, none of them empty, not {pads}.")
        for pad in self.pads:
            positive_number(f"HandConfig.pads[{pad.name}].alpha", pad.alpha, most=MOST_ALPHA)
        self._check_followers()
        for joint, position in self.rest_positions.items():
            known_name("each name in HandConfig.rest_positions", joint, self.driven)
            finite_array(f"HandConfig.rest_positions[{joint}]", [position], (1,))
        self._check_grip()

    def _check_kinds(self) -> None:
        """Raises InvalidInputError if a finger, a surface or a pad is of another type, as Python lets it be."""
        surfaces = (SphereSurface, EllipsoidSurface, CapsuleSurface, SuperquadricSurface)
        for i, finger in enumerate(self.fingers):
            instance_of(f"HandConfig.fingers[{i}]", finger, FingerConfig)
            instance_of(f"HandConfig.fingers[{finger.name}].surface", finger.surface, *surfaces)
        for i, pad in enumerate(self.pads):
            instance_of(f"HandConfig.pads[{i}]", pad, PadConfig)

    def _check_sensors(self) -> None:
        """Raises InvalidInputError if two fingers share a sensor, which would count twice."""
        for key in ("sensor_frame", "weld"):
            owners: dict[str, str] = {}
            for finger in self.fingers:
                name = getattr(finger, key)
                if name and name in owners:
                    raise InvalidInputError(
                        f"HandConfig.fingers[{finger.name}].{key} must differ from that of the finger "
                        f"{owners[name]!r}, but both are {name!r}."
                    )
                owners[name] = finger.name

    def _check_followers(self) -> None:
        """Raises InvalidInputError if a coupled joint is also actuated, or has two different couplings."""
        for finger in self.fingers:
            for coupling in finger.couplings:
                joint, leader = coupling.joint, coupling.follows
                where = f"HandConfig.fingers[{finger.name}].couplings: the coupling of {joint!r}"
                if joint in self.driven:
                    raise InvalidInputError(
                        f"{where} must be of a joint that is not among the joints of a finger, which follow none. "
                        f"Couple joints that follow {joint!r} to {leader!r} as well."
                    )
                if coupling != self.couplings[joint]:
                    raise InvalidInputError(f"{where} must be the same in all fingers that share it, but differs.")

    def _check_grip(self) -> None:
        """Raises InvalidInputError if the grip region has only one corner, is inverted, or is in millimetres."""
        if bool(self.grip_low) != bool(self.grip_high):
            raise InvalidInputError(
                f"HandConfig must have both grip_low and grip_high, or neither, not {self.grip_low} and "
                f"{self.grip_high}."
            )
        if not self.grip_low:
            return
        low = points_near("HandConfig.grip_low", [self.grip_low], (1, 3))
        high = points_near("HandConfig.grip_high", [self.grip_high], (1, 3))
        if not np.all(low < high):
            raise InvalidInputError(
                f"HandConfig.grip_low must be less than grip_high {self.grip_high} along each axis, not "
                f"{self.grip_low}."
            )

    @property
    def couplings(self) -> dict[str, Coupling]:
        """All fingers' couplings by the joint that follows; fingers that share the joint have the same coupling."""
        return {coupling.joint: coupling for finger in self.fingers for coupling in finger.couplings}

    @property
    def sensing(self) -> tuple[str, ...]:
        """Names of the fingers that have a force-torque sensor."""
        return tuple(finger.name for finger in self.fingers if finger.sensor_frame)

    @property
    def driven(self) -> tuple[str, ...]:
        """The joints that move the fingers, finger by finger, each only once: fingers may share one."""
        return tuple(dict.fromkeys(joint for finger in self.fingers for joint in finger.joints))

    def finger(self, name: str) -> FingerConfig:
        """The finger of that name.

        Raises:
            UnknownNameError: if there is none.
        """
        for finger in self.fingers:
            if finger.name == name:
                return finger
        raise UnknownNameError("finger", name, [finger.name for finger in self.fingers])


def load_hand_config(name_or_path: str | Path, *, with_calibration: bool = True) -> HandConfig:
    """Reads a `*.hand.yaml`: one of the package's hands by name, or any file by path.

    Relative paths of models and arrays are relative to the file's folder.

    Args:
        name_or_path: name of the hand, or path of its file.
        with_calibration: whether to check the calibration that the file names; a new calibration does not need it.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit `HandConfig`, or a value is out of its range.
    """
    path = named_file(name_or_path, "hands", model_path("hands").glob("*/*.hand.yaml"), ".hand.yaml")
    config = load_typed_yaml(HandConfig, path)
    with told_of(f"{path}: ", InvalidFileError):
        config.validate()
    if "://" not in config.model:
        config.model = str(path.parent / config.model)
    for pad in config.pads:
        if Path(pad.array).suffix:
            pad.array = str(path.parent / pad.array)
    if config.calibration:
        config.calibration = str(path.parent / config.calibration)
        if with_calibration:
            load_calibration(Path(config.calibration))
    return config
