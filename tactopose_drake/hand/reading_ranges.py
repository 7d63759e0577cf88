"""Ranges of plausible joint readings; a reading far beyond the joint's limits is a fault, or in degrees."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint

from tactopose_drake.core.geometry_checks import FARTHEST
from tactopose_drake.core.validation import FloatArray

_MARGIN_RAD, _MARGIN_M = 0.5, 0.05  # by which a reading may exceed a joint's limits, as encoders have offsets


class ReadingRange(NamedTuple):
    """The range of plausible readings of one joint.

    Attributes:
        least: smallest plausible reading, rad or m.
        most: largest plausible reading, rad or m.
        unit: unit of both.
    """

    least: float
    most: float
    unit: str

    @classmethod
    def of(cls, joint: Joint) -> ReadingRange:
        """The range of a joint with one position; a prismatic joint without limits is bounded to 5 m."""
        low, high = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        slides = isinstance(joint, PrismaticJoint)
        unit, margin, free = ("m", _MARGIN_M, 0.5 * FARTHEST) if slides else ("rad", _MARGIN_RAD, math.inf)
        least, most = (low - margin, high + margin) if low < high else (-free, free)
        return cls(max(least, -free), min(most, free), unit)


@dataclasses.dataclass(frozen=True, eq=False)
class ReadingRanges:
    """The ranges of plausible readings of all joints in a plant of a hand alone.

    Attributes:
        names: names of the joints, by the index of their position.
        ranges: their ranges, likewise.
    """

    names: dict[int, str]
    ranges: dict[int, ReadingRange]
    _least: FloatArray
    _most: FloatArray

    @classmethod
    def of(cls, plant: MultibodyPlant) -> ReadingRanges:
        """The ranges of a finalized plant's joints."""
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        moving = {joint.position_start(): joint for joint in joints if joint.num_positions() == 1}
        ranges = {place: ReadingRange.of(joint) for place, joint in moving.items()}
        least, most = np.full((2, plant.num_positions()), [[-np.inf], [np.inf]])
        for place, of_joint in ranges.items():
            least[place], most[place] = of_joint.least, of_joint.most
        return cls({place: joint.name() for place, joint in moving.items()}, ranges, least, most)

    def told(self, q: FloatArray) -> NDArray[np.bool_]:
        """Whether each reading is known and plausible, shape (nq,); False for NaN."""
        return np.isfinite(q) & (q >= self._least) & (q <= self._most)

    def fault(self, place: int, reading: float) -> str:
        """Describes an implausible reading of the position at an index; empty for NaN."""
        if np.isnan(reading):
            return ""
        least, most, unit = self.ranges[place]
        return f"joint {self.names[place]} reads {reading:.4g} {unit}, not from {least:.4g} to {most:.4g}"
