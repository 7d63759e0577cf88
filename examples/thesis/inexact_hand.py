"""The hand of `pad_grasps.py` with errors of its files: offsets of the joint encoders, and of the arrays' poses.

A grip's pressures are unchanged; the poses of the pads that are passed to the estimation are wrong. The errors of each
hand are drawn independently: the offset of each encoder (of the spread, and of each finger's proximal joint, which the
distal joint follows), and for each array, including the palm's, a translation along and a rotation about each axis.
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
    """Standard deviations of a hand's errors: arrays along each axis, mm; joints, and arrays about each axis, deg."""

    mm: float
    deg: float

    def __str__(self) -> str:
        return f"{self.mm:g} mm, {self.deg:g} deg"


class InexactHand:
    """Draws hands, and the patches that they feel."""

    def __init__(self, name: str = "barrett_like") -> None:
        config = load_hand_config(name)
        self._plant, self._hand = make_hand_plant(config)
        self._kinematics = HandKinematics(self._plant, self._hand.palm_frame)
        self._gains = encoder_gains(self._plant, self._hand).gains
        self._layouts = {pad.name: load_tactile_pad(pad.array).layout for pad in config.pads}

    def feel(self, grasp: PadGrasp, level: Level, generator: np.random.Generator) -> tuple[Patch, ...]:
        """The grasp's patches at the poses where a drawn hand assumes them, with the uncertainty that its file
        declares.
        """
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
        """The arrays' poses, each (3, 4); leaves the kinematics at these joint positions."""
        self._kinematics.move(q)
        return {pad: X.GetAsMatrix34() for pad, X in self._kinematics.poses(self._hand.pad_frames).items()}


def untold(patches: tuple[Patch, ...]) -> tuple[Patch, ...]:
    """The same patches without the declared uncertainty of the hand."""
    return tuple(dataclasses.replace(patch, misplacement=None) for patch in patches)
