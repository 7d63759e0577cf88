"""What a calibration says of a hand, and the YAML file that a hand's own file names."""

import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tactopose_drake.core.validation import FloatArray, finite_array, positive_number
from tactopose_drake.errors import InvalidFileError, InvalidInputError, UnknownNameError
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.resources import load_typed_yaml

_LARGEST = {"joint_offset": 90.0, "force": 1e3, "moment": 1e2, "length": 0.1, "mounting_deg": 90.0}


@dataclasses.dataclass(kw_only=True, slots=True)
class MeasuredNumber:
    """A number that was found."""

    value: float = 0.0  # in the unit that is told there
    sigma: float = 0.0  # its standard deviation


@dataclasses.dataclass(kw_only=True, slots=True)
class MeasuredVector:
    """Three numbers that were found, along x, y and z of the sensor's frame."""

    value: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 0.0])  # in the unit that is told there
    sigma: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 0.0])  # their standard deviations


@dataclasses.dataclass(kw_only=True, slots=True)
class FingerCalibration:
    """One finger's fingertip and force-torque sensor."""

    moment_bias: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # read without a touch, N m
    force_bias: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # N
    # By how much the fingertip is thicker than told, m.
    radius: MeasuredNumber = dataclasses.field(default_factory=MeasuredNumber)
    rotation_deg: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # of the sensor on its finger, deg
    translation: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # likewise, m
    joints: list[str] = dataclasses.field(default_factory=list)  # whose offsets are first in `correlation`
    # Of the joints' offsets, the moment's bias, the force's, the radius, the rotation and the translation. Empty: they
    # are independent.
    correlation: list[list[float]] = dataclasses.field(default_factory=list)

    @property
    def bias(self) -> FloatArray:
        """[m, f], shape (6,), N m and N."""
        return np.concatenate([self.moment_bias.value, self.force_bias.value])

    @property
    def mounting(self) -> FloatArray:
        """Rotation vector and translation, shape (6,), rad and m."""
        return np.concatenate([np.radians(self.rotation_deg.value), self.translation.value])

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the biases, the radius and the mounting, shape (13,), SI units."""
        turned = np.radians(self.rotation_deg.sigma).tolist()
        biases = [*self.moment_bias.sigma, *self.force_bias.sigma]
        return np.array([*biases, self.radius.sigma, *turned, *self.translation.sigma])

    def after_tare(self, sensor_moment: float, sensor_force: float) -> "FingerCalibration":
        """The same after its sensor was tared: without the biases that were found, nor what they tell of the rest.

        Args:
            sensor_moment: standard deviation of each component of the moment's bias after a tare, N m.
            sensor_force: of the force's, N.
        """
        first = len(self.joints)
        correlation = np.array(self.correlation)
        if self.correlation:
            correlation[first : first + 6] = correlation[:, first : first + 6] = 0.0
            np.fill_diagonal(correlation, 1.0)
        return dataclasses.replace(
            self,
            moment_bias=MeasuredVector(sigma=[sensor_moment] * 3),
            force_bias=MeasuredVector(sigma=[sensor_force] * 3),
            correlation=correlation.tolist(),
        )

    def validate(self, where: str) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for name, most in (
            ("moment_bias", _LARGEST["moment"]),
            ("force_bias", _LARGEST["force"]),
            ("rotation_deg", _LARGEST["mounting_deg"]),
            ("translation", _LARGEST["length"]),
        ):
            vector: MeasuredVector = getattr(self, name)
            _check(f"{where}.{name}.value", vector.value, most)
            _check(f"{where}.{name}.sigma", vector.sigma, math.inf, least=0.0)
        _check(f"{where}.radius.value", [self.radius.value], _LARGEST["length"], count=1)
        _check(f"{where}.radius.sigma", [self.radius.sigma], math.inf, least=0.0, count=1)
        size = len(self.joints) + 13
        if self.correlation:
            correlation = finite_array(f"{where}.correlation", self.correlation, (size, size))
            off = np.abs(correlation - correlation.T).max(), np.abs(np.diag(correlation) - 1.0).max()
            if max(off) > 1e-3 or np.linalg.eigvalsh(correlation)[0] < -1e-2:
                raise InvalidInputError(
                    f"{where}.correlation: is no correlation matrix; allowed is a symmetric matrix with 1 on its "
                    "diagonal and no eigenvalue below 0."
                )


@dataclasses.dataclass(kw_only=True, slots=True)
class CalibrationNoise:
    """What remains when all errors that grasps share are known: standard deviations of a single contact."""

    position: float = 0.0003  # of where its point is, m
    normal_deg: float = 1.0  # of its normal about each axis, deg
    moment: float = 0.00002  # of each component of the moment, N m
    force: float = 0.004  # of each component of the force, N


@dataclasses.dataclass(kw_only=True, slots=True)
class HandCalibration:
    """What a calibration found: a `calibration.yaml`."""

    grasps: int = 0  # that it was made from
    # By which each joint's reading exceeds its position, deg; of joints that slide, m.
    joint_offsets: dict[str, MeasuredNumber] = dataclasses.field(default_factory=dict)
    fingers: dict[str, FingerCalibration] = dataclasses.field(default_factory=dict)  # by their names
    noise: CalibrationNoise = dataclasses.field(default_factory=CalibrationNoise)  # of a contact
    undetermined: list[str] = dataclasses.field(default_factory=list)  # what the grasps could not tell, in words

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for joint, offset in self.joint_offsets.items():
            where = f"joint_offsets.{joint}"
            _check(f"{where}.value", [offset.value], _LARGEST["joint_offset"], count=1)
            _check(f"{where}.sigma", [offset.sigma], math.inf, least=0.0, count=1)
        for name, finger in self.fingers.items():
            finger.validate(f"fingers.{name}")
            for joint in finger.joints:
                if joint not in self.joint_offsets:
                    raise UnknownNameError(f"fingers.{name}.joints", joint, self.joint_offsets)
        for field in dataclasses.fields(self.noise):
            positive_number(f"noise.{field.name}", getattr(self.noise, field.name))

    def check_names(self, joints: Iterable[str], fingers: Iterable[str]) -> None:
        """Raises UnknownNameError if it is not of a hand with these encoders' joints and these fingers."""
        joints, fingers = list(joints), list(fingers)
        for joint in self.joint_offsets:
            if joint not in joints:
                raise UnknownNameError("joint_offsets", joint, joints)
        for finger in self.fingers:
            if finger not in fingers:
                raise UnknownNameError("fingers", finger, fingers)


def load_calibration(path: Path) -> HandCalibration:
    """Reads a calibration.yaml.

    Raises:
        InvalidFileError: if the file cannot be read, does not fit, or a value is out of its range.
    """
    calibration = load_typed_yaml(HandCalibration, path)
    try:
        calibration.validate()
    except InvalidInputError as error:
        raise InvalidFileError(f"{path}: {error}") from None
    return calibration


def save_calibration(path: Path, calibration: HandCalibration) -> None:
    """Writes a calibration.yaml, which a hand's file names by its key `calibration`.

    Raises:
        InvalidFileError: if the file cannot be written.
    """
    text = yaml.safe_dump(
        dataclasses.asdict(calibration), sort_keys=False, default_flow_style=None, width=120, allow_unicode=True
    )
    with written_beside(path) as beside:
        beside.write_text(text, encoding="utf-8")


def rounded(value: Any, digits: int = 6) -> Any:
    """Numbers, and those in lists, with so many digits that count."""
    if isinstance(value, list | np.ndarray):
        return [rounded(item, digits) for item in value]
    return float(f"{float(value):.{digits}g}")


def _check(name: str, values: list[float], most: float, *, least: float | None = None, count: int = 3) -> None:
    array = finite_array(name, values, (count,))
    lowest = -most if least is None else least
    if np.any(array < lowest) or np.any(array > most):
        allowed = f"numbers from {lowest:g} to {most:g}" if math.isfinite(most) else "numbers >= 0"
        raise InvalidInputError(f"{name}: is {array.tolist()}; allowed are {allowed}.")
