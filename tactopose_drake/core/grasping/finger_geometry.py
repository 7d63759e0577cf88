"""A finger as grasp planning sees it: its kinematics, and its shape as spheres with a round end."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core import poses
from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.grasping import chain_kernels
from tactopose_drake.core.grasping.serial_chain import SerialChain
from tactopose_drake.core.shape.sphere_packing import Spheres
from tactopose_drake.core.validation import FloatArray


@dataclass(frozen=True, eq=False)
class FingerGeometry:
    """A finger's kinematics and shape.

    Attributes:
        chain: kinematics from palm to sensor.
        p_ST: centre of the fingertip's round end in the sensor's frame, shape (3,), m.
        tip_radius: m.
        body: index of the body of the chain that each sphere is fixed on, shape (s,).
        p_BH: centres of spheres that fill the finger without its tip, in their bodies, shape (s, 3), m.
        radius: their radii, shape (s,), m.
        p_SR: root of the fingertip's axis, which ends in p_ST, in the sensor's frame, shape (3,), m; p_ST itself if the
            fingertip has no axis and may touch on any side.
        p_SL: start of the fingertip's straight part in the sensor's frame, which is as thick as the round end and leads
            to it, shape (3,), m; None if the fingertip is its round end alone.
    """

    chain: SerialChain
    p_ST: FloatArray
    tip_radius: float
    body: NDArray[np.intp]
    p_BH: FloatArray
    radius: FloatArray
    p_SR: FloatArray = field(default_factory=lambda: np.zeros(3))
    p_SL: FloatArray | None = None

    @property
    def has_axis(self) -> bool:
        """Whether the fingertip has an axis."""
        return bool(np.any(self.p_ST != self.p_SR))

    @property
    def on_last_links(self) -> NDArray[np.bool_]:
        """Which of the spheres are on the finger's last two links, shape (s,)."""
        last: NDArray[np.bool_] = self.body >= len(self.chain.bodies) - 2
        return last

    def spheres(self, q: FloatArray) -> FloatArray:
        """Centres in P, shape (B, s, 3), for positions q (B, m), rad."""
        return self._spheres_on(self.chain.body_poses(q))

    def axis(self, q: FloatArray) -> FloatArray:
        """Points in P on the finger's axis from its last two joints to the round end's centre, at most (B, 4, 3)."""
        X_PB, X_PS = self.chain.all_poses(q)
        ends = [self._on_axis(X_PS, height)[:, None] for height in (0.0, 1.0)]
        return np.concatenate([X_PB[:, -2:, :, 3], *ends], axis=1)

    def tip(self, q: FloatArray, height: float = 1.0) -> FloatArray:
        """Points in P on the line from the root of the axis (height 0) to the round end's centre (1), shape (B, 3)."""
        return self._on_axis(self.chain.sensor_poses(q), height)

    def along_straight_part(self, places: int) -> FloatArray:
        """Points in S on the axis of the straight part, from its start to before the round end, shape (p, 3)."""
        if self.p_SL is None:
            return np.zeros((0, 3))
        share = np.linspace(0.0, 1.0, places, endpoint=False)[:, None]
        return self.p_SL + share * (self.p_ST - self.p_SL)

    def fixed_points(self, q: FloatArray, p_SQ: FloatArray) -> FloatArray:
        """Transforms points p_SQ (p, 3) to P for positions q (B, m), shape (B, p, 3), m."""
        X_PS = self.chain.sensor_poses(q)
        points: FloatArray = np.einsum("bij,pj->bpi", X_PS[..., :3], p_SQ) + X_PS[:, None, :, 3]
        return points

    def all_spheres(self, q: FloatArray) -> Spheres:
        """Centres (B, s, 3) in P and radii (s,), m, of the finger with its tip, from the root of its axis on."""
        X_PB, X_PS = self.chain.all_poses(q)
        ends = [self._on_axis(X_PS, height)[:, None] for height in (0.0, 1.0)]
        return np.concatenate([self._spheres_on(X_PB), *ends], axis=1), np.append(self.radius, [self.tip_radius] * 2)

    def _spheres_on(self, X_PB: FloatArray) -> FloatArray:
        """Centres of the spheres on bodies at poses (B, k, 3, 4), in P."""
        centres = np.empty((len(X_PB), *self.p_BH.shape))
        chain_kernels.place_points(X_PB, read_only(self.body), read_only(self.p_BH), centres)
        return centres

    def _on_axis(self, X_PS: FloatArray, height: float) -> FloatArray:
        """The same as `tip`, for sensors at poses (B, 3, 4)."""
        p_SQ = self.p_SR + height * (self.p_ST - self.p_SR)
        return poses.transform_points(X_PS, p_SQ[None])[:, 0]
