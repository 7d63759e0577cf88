"""A depth image of an object alone, taken from a known place."""

from dataclasses import dataclass

import numpy as np

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.number_kinds import entry_of
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.validation import FloatArray, instance_of
from tactopose_drake.core.vision.depth_pictures import DepthCameraModel, checked_depth, rays
from tactopose_drake.errors import InvalidInputError


@dataclass(frozen=True, eq=False)
class DepthView:
    """One depth image of an object at rest, with nothing else in it.

    Attributes:
        depth: shape (height, width), m, above 0; infinite where nothing is seen, so that the object is not there, and
            NaN where the camera has no answer.
        X_CO: pose of the frame that the object's mesh is to have, in the camera, shape (3, 4); a RigidTransform is
            taken too.
        camera: that took the image.

    Raises:
        InvalidInputError: an image of another size than the camera's or evidently in millimetres, a depth of 0 or
            below, or an invalid pose.
    """

    depth: FloatArray
    X_CO: FloatArray
    camera: DepthCameraModel

    def __post_init__(self) -> None:
        instance_of("DepthView.camera", self.camera, DepthCameraModel)
        depth = checked_depth("DepthView.depth", self.depth, self.camera)
        wrong = np.argwhere(depth <= 0.0)
        if len(wrong):
            raise InvalidInputError(
                f"{entry_of('DepthView.depth', wrong[0])} must be a number > 0, infinity where nothing is seen, or NaN "
                f"where the camera has no answer, not {depth[tuple(wrong[0])]:g}."
            )
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "X_CO", pose_matrix("DepthView.X_CO", self.X_CO))

    @property
    def p_OQ(self) -> FloatArray:
        """The points seen, in the object's frame, shape (n, 3), m."""
        seen = np.isfinite(self.depth)
        p_CQ = rays(self.camera)[seen] * self.depth[seen][:, None]
        points: FloatArray = (p_CQ - self.X_CO[:, 3]) @ self.X_CO[:, :3]
        return points

    def depth_behind(self, p_OQ: FloatArray) -> FloatArray:
        """Depth of the surface seen at the pixels of points (n, 3), minus that of the points, shape (n,), m.

        Infinite where nothing is seen, NaN outside the image and where the camera has no answer.
        """
        p_CQ = transform_points(self.X_CO, p_OQ)
        z = np.maximum(p_CQ[:, 2], 1e-6)
        column = np.floor(self.camera.focal_length * p_CQ[:, 0] / z + self.camera.center[0]).astype(int)
        row = np.floor(self.camera.focal_length * p_CQ[:, 1] / z + self.camera.center[1]).astype(int)
        inside = (column >= 0) & (column < self.camera.width) & (row >= 0) & (row < self.camera.height)
        behind = np.full(len(p_OQ), np.nan)
        behind[inside] = self.depth[row[inside], column[inside]] - p_CQ[inside, 2]
        return behind
