"""The result of a hand's calibration, and its YAML file, which the hand's own file names."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tactopose_drake.core.validation import (
    FloatArray,
    finite_array,
    known_name,
    limited,
    positive_number,
    positive_numbers,
    told_of,
)
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.resources import load_typed_yaml

_LARGEST = {"joint_offset": 90.0, "force": 1e3, "moment": 1e2, "length": 0.1, "mounting_deg": 90.0}


@dataclasses.dataclass(kw_only=True, slots=True)
class MeasuredNumber:
    """A number that a calibration found."""

    value: float = 0.0  # in the unit of the field that holds it
    sigma: float = 0.0  # its standard deviation


@dataclasses.dataclass(kw_only=True, slots=True)
class MeasuredVector:
    """Three numbers that a calibration found, along x, y and z of the sensor's frame."""

    value: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 0.0])  # in the unit of the holding field
    sigma: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0, 0.0])  # their standard deviations


@dataclasses.dataclass(kw_only=True, slots=True)
class FingerCalibration:
    """Calibration of one finger's fingertip and force-torque sensor."""

    moment_bias: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # read without a touch, N m
    force_bias: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # N
    # Excess of the fingertip's radius over the hand's file, m.
    radius: MeasuredNumber = dataclasses.field(default_factory=MeasuredNumber)
    rotation_deg: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # of the sensor on its finger, deg
    translation: MeasuredVector = dataclasses.field(default_factory=MeasuredVector)  # likewise, m
    joints: list[str] = dataclasses.field(default_factory=list)  # whose offsets come first in `correlation`
    # Correlation matrix of the joints' offsets, moment bias, force bias, radius, rotation and translation. Empty: they
    # are independent.
    correlation: list[list[float]] = dataclasses.field(default_factory=list)

    @property
    def bias(self) -> FloatArray:
        """The bias [m, f], shape (6,), N m and N."""
        return np.concatenate([self.moment_bias.value, self.force_bias.value])

    @property
    def mounting(self) -> FloatArray:
        """The sensor's mounting error: rotation vector and translation, shape (6,), rad and m."""
        return np.concatenate([np.radians(self.rotation_deg.value), self.translation.value])

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the biases, the radius and the mounting, shape (13,), SI units."""
        turned = np.radians(self.rotation_deg.sigma).tolist()
        biases = [*self.moment_bias.sigma, *self.force_bias.sigma]
        return np.array([*biases, self.radius.sigma, *turned, *self.translation.sigma])

    def after_tare(self, sensor_moment: float, sensor_force: float) -> "FingerCalibration":
        """The calibration after the sensor was tared: without the biases and their correlations with other errors.

        Args:
            sensor_moment: standard deviation of each component of the moment's bias after a tare, N m.
            sensor_force: standard deviation of each component of the force's bias after a tare, N.
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
            limited(f"{where}.{name}.value", vector.value, (3,), most=most)
            positive_numbers(f"{where}.{name}.sigma", vector.sigma, (3,), allow_zero=True)
        limited(f"{where}.radius.value", self.radius.value, (), most=_LARGEST["length"])
        positive_number(f"{where}.radius.sigma", self.radius.sigma, allow_zero=True)
        size = len(self.joints) + 13
        if self.correlation:
            correlation = finite_array(f"{where}.correlation", self.correlation, (size, size))
            off = np.abs(correlation - correlation.T).max(), np.abs(np.diag(correlation) - 1.0).max()
            if max(off) > 1e-3 or np.linalg.eigvalsh(correlation)[0] < -1e-2:
                raise InvalidInputError(
                    f"{where}.correlation must be a correlation matrix, symmetric with 1 on its diagonal and no "
                    "eigenvalue below 0."
                )


@dataclasses.dataclass(kw_only=True, slots=True)
class CalibrationNoise:
    """Noise of a single contact that remains after calibration: standard deviations."""

    position: float = 0.0003  # of its point along each axis, m
    normal_deg: float = 1.0  # of its normal about each axis, deg
    moment: float = 0.00002  # of each component of the moment, N m
    force: float = 0.004  # of each component of the force, N


@dataclasses.dataclass(kw_only=True, slots=True)
class HandCalibration:
    """The content of a `calibration.yaml`."""

    grasps: int = 0  # number of grasps that were used
    # Excess of each joint's reading over its position, deg; for prismatic joints, m.
    joint_offsets: dict[str, MeasuredNumber] = dataclasses.field(default_factory=dict)
    fingers: dict[str, FingerCalibration] = dataclasses.field(default_factory=dict)  # by name
    noise: CalibrationNoise = dataclasses.field(default_factory=CalibrationNoise)  # of a contact
    undetermined: list[str] = dataclasses.field(default_factory=list)  # what the grasps do not determine, in words

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for joint, offset in self.joint_offsets.items():
            where = f"joint_offsets.{joint}"
            limited(f"{where}.value", offset.value, (), most=_LARGEST["joint_offset"])
            positive_number(f"{where}.sigma", offset.sigma, allow_zero=True)
        for name, finger in self.fingers.items():
            finger.validate(f"fingers.{name}")
            for joint in finger.joints:
                known_name(f"each name in fingers.{name}.joints", joint, self.joint_offsets)
        for field in dataclasses.fields(self.noise):
            positive_number(f"noise.{field.name}", getattr(self.noise, field.name))

    def check_names(self, joints: Iterable[str], fingers: Iterable[str]) -> None:
        """Raises UnknownNameError if it names a joint or finger that is not among these."""
        joints, fingers = list(joints), list(fingers)
        for joint in self.joint_offsets:
            known_name("each name in joint_offsets", joint, joints)
        for finger in self.fingers:
            known_name("each name in fingers", finger, fingers)


def load_calibration(path: Path) -> HandCalibration:
    """Reads a calibration.yaml.

    Raises:
        InvalidFileError: if the file cannot be read, does not fit the format, or has a value out of range.
    """
    calibration = load_typed_yaml(HandCalibration, path)
    with told_of(f"{path}: ", InvalidFileError):
        calibration.validate()
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


def rounded(value: Any) -> Any:
    """A number, or the numbers in nested lists, rounded to six significant digits."""
    if isinstance(value, list | np.ndarray):
        return [rounded(item) for item in value]
    return float(f"{float(value):.6g}")
