"""The hand of `pad_grasps.py` when it is not as its files say: joints' zeros are off, and arrays sit elsewhere.

A grip's pressures stay what they were; where the pads are, is what the estimation is told wrongly. Each time a hand is
drawn anew: the zero of each encoder (the spread, and each finger's proximal joint, whose distal joint follows it), and
for each array, the palm's too, a shift along and a turn about each axis.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from pad_grasps import Array, PadGrasp

from tactopose_drake.core.poses import compose, exp_so3, inverse, make_poses, transform_points
from tactopose_drake.core.sensing import Patch, describe_patch
from tactopose_drake.hand import (
    HandKinematics,
    HandUncertainty,
    PadUncertainty,
    encoder_gains,
    load_hand_config,
    load_tactile_pad,
    make_hand_plant,
)


class Level(NamedTuple):
    """By how much a hand is off, one standard deviation: arrays along each axis, mm; joints and arrays' turns, deg."""

    mm: float
    deg: float

    def __str__(self) -> str:
        return f"{self.mm:g} mm, {self.deg:g} deg"


class InexactHand:
    """Draws hands, and what is felt with them."""

    def __init__(self, name: str = "barrett_like") -> None:
        config = load_hand_config(name)
        self._plant, self._hand = make_hand_plant(config)
        self._kinematics = HandKinematics(self._plant, self._hand.palm_frame)
        self._gains = encoder_gains(self._plant, self._hand).gains
        self._layouts = {pad.name: load_tactile_pad(pad.array).layout for pad in config.pads}

    def feel(self, grasp: PadGrasp, level: Level, generator: np.random.Generator) -> tuple[Patch, ...]:
        """The grasp's patches where a drawn hand believes them to be, with what its file would declare of that."""
        errors = HandUncertainty(
            encoder_offset_deg=level.deg, mounting=1e-3 * level.mm, mounting_deg=level.deg, fingertip_radius=0.0
        )
        declared = PadUncertainty(self._plant, self._hand, errors)
        true = self._poses(grasp.q)
        offsets = math.radians(level.deg) * generator.normal(size=self._gains.shape[1])
        believed = self._poses(grasp.q + self._gains @ offsets)
        patches = []
        for (name, layout), patch in zip(self._layouts.items(), grasp.patches, strict=True):
            shift = 1e-3 * level.mm * generator.normal(size=3)
            R = exp_so3(math.radians(level.deg) * generator.normal(size=3))
            middle = transform_points(believed[name], layout.p_TC).mean(axis=0)
            mounted = make_poses(R, middle - R @ middle + shift)
            X = compose(compose(mounted, believed[name]), inverse(true[name]))
            patches.append(
                describe_patch(
                    transform_points(X, patch.p_PT),
                    patch.pressure,
                    alpha=patch.alpha,
                    n_PT=patch.n_PT @ X[:, :3].T,
                    threshold=patch.threshold,
                    saturation=patch.saturation if math.isfinite(patch.saturation) else None,
                    misplacement=declared.covariance(name, layout, self._kinematics),
                )
            )
        return tuple(patches)

    def _poses(self, q: Array) -> dict[str, Array]:
        """Where the arrays are, each (3, 4); leaves the kinematics there."""
        self._kinematics.move(q)
        return {pad: X.GetAsMatrix34() for pad, X in self._kinematics.poses(self._hand.pad_frames).items()}


def untold(patches: tuple[Patch, ...]) -> tuple[Patch, ...]:
    """The same, but that nothing is declared of the hand."""
    return tuple(dataclasses.replace(patch, misplacement=None) for patch in patches)
