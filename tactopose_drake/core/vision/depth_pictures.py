"""What a depth camera sees around a hand: its noise, which pixels are the hand's, and where a pose does not fit them.

Sources: [K12] K. Khoshelham and S. Elberink, Accuracy and resolution of Kinect depth data, Sensors, 2012.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, maximum_filter

from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, positive_number, whole_number
from tactopose_drake.core.vision.rasterizer import Camera, inverse_depths
from tactopose_drake.errors import InvalidInputError

_DISAGREEMENT = 0.01  # of depths; what differs by more counts as this, m
_MARGIN = 0.004  # by which one surface must lie before another to hide it, beyond three sigma of the noise, m


@dataclasses.dataclass(kw_only=True, slots=True)
class DepthCameraModel:
    """What the camera measures."""

    width: int = 240  # of the image, pixels
    height: int = 180  # pixels
    focal_length: float = 200.0  # pixels
    depth_noise: float = 1.43e-3  # standard deviation of a depth z over z^2, 1/m: the Kinect's [K12]
    # Of its variance, that is the same all over a patch of pixels: no averaging over the object takes it away.
    common_share: float = 0.3
    nearest: float = 0.1  # that is measured, m
    farthest: float = 3.0  # m

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for name in ("width", "height"):
            whole_number(f"DepthCameraModel.{name}", getattr(self, name), least=1)
        for name in ("focal_length", "nearest", "farthest"):
            positive_number(f"DepthCameraModel.{name}", getattr(self, name))
        positive_number("DepthCameraModel.depth_noise", self.depth_noise, allow_zero=True)
        positive_number("DepthCameraModel.common_share", self.common_share, allow_zero=True, most=1.0)
        if self.nearest >= self.farthest:
            raise InvalidInputError(
                f"DepthCameraModel.nearest: is {self.nearest:g}; allowed is less than `farthest`, {self.farthest:g}."
            )

    @property
    def at_origin(self) -> Camera:
        """The camera in its own frame."""
        return Camera(np.eye(3, 4), self.focal_length, self.width, self.height)


@dataclass(frozen=True, eq=False)
class DepthPicture:
    """What a depth camera sees of object and hand.

    Attributes:
        depth: along the camera's axis at each pixel, shape (height, width), m; infinite where nothing is seen.
        hand: which pixels are the hand's, as rendered from its joints, shape (height, width).
        camera: what took it.
    """

    depth: FloatArray
    hand: NDArray[np.bool_]
    camera: DepthCameraModel

    def points(self, *, without_hand: bool) -> FloatArray:
        """Points on what is seen, in the camera's frame, shape (n, 3), m."""
        chosen = np.isfinite(self.depth) & ~self.hand if without_hand else np.isfinite(self.depth)
        row, column = np.nonzero(chosen)
        return rays(self.camera)[row, column] * self.depth[row, column, None]


@dataclass(frozen=True)
class PictureFit:
    """How a picture agrees with the object at a pose.

    Attributes:
        hidden_share: of the pixels where the object would be seen, those where something nearer is, 0 to 1.
        seen_through: of the others, those where something farther or nothing is seen, 0 to 1.
        misfit: root mean square of how much farther these others see than the object, m.
        disagreement: how far the picture and the object's own image are apart, on average over the pixels of either, up
            to a centimetre, m: where the object should be seen and is not, and where something is seen that it does not
            explain, counts against it.
    """

    hidden_share: float
    seen_through: float
    misfit: float
    disagreement: float


def rays(camera: DepthCameraModel) -> FloatArray:
    """The points of depth 1 m that the pixels see, in the camera's frame, shape (height, width, 3), m."""
    row, column = np.mgrid[: camera.height, : camera.width] + 0.5
    across, down = column - 0.5 * camera.width, row - 0.5 * camera.height
    found: FloatArray = np.stack([across, down, np.full_like(row, camera.focal_length)], axis=2) / camera.focal_length
    return found


def noisy_depth(depth: FloatArray, camera: DepthCameraModel, generator: np.random.Generator) -> FloatArray:
    """A depth image with the camera's noise; what is infinite stays so.

    Args:
        depth: shape (height, width), m.
        camera: size and noise.
        generator: of the noise.

    Raises:
        InvalidInputError: if the image is not as large as the camera's.
    """
    _check_size(depth, camera)
    row, column = np.mgrid[: camera.height, : camera.width] + 0.5
    weights = generator.normal(size=3)  # errors in common: a random plane over the image
    common = weights[0] + weights[1] * (row / camera.height - 0.5) + weights[2] * (column / camera.width - 0.5)
    single = generator.normal(size=depth.shape)
    noise = math.sqrt(1.0 - camera.common_share) * single + math.sqrt(camera.common_share) * common
    seen = np.isfinite(depth)
    exact = np.where(seen, depth, 0.0)
    noisy: FloatArray = np.where(seen, exact + camera.depth_noise * exact**2 * noise, np.inf)
    return noisy


def take_picture(
    depth: FloatArray, hand_vertices: FloatArray, hand_faces: NDArray[np.int32], camera: DepthCameraModel
) -> DepthPicture:
    """A depth image in which the hand's pixels are known.

    A pixel is the hand's where the hand, as its joints have it, is rendered there or beside it, and nothing is seen
    before it.

    Args:
        depth: shape (height, width), m; 0, infinite or NaN where nothing is seen.
        hand_vertices: in the camera's frame C, z forward, shape (v, 3), m.
        hand_faces: vertex indices, shape (f, 3).
        camera: what took it.

    Raises:
        InvalidInputError: if the image is not as large as the camera's.
    """
    _check_size(depth, camera)
    seen = np.isfinite(depth) & (depth > 0.0)
    measured = np.where(seen, depth, np.inf).astype(np.float64)
    hand = maximum_filter(inverse_depths(hand_vertices, hand_faces, camera.at_origin), size=3)
    finite = np.where(seen, measured, 0.0)
    behind = hand * (finite + _margin(finite, camera)) >= 1.0
    return DepthPicture(measured, seen & (hand > 0.0) & behind, camera)


def _check_size(depth: FloatArray, camera: DepthCameraModel) -> None:
    if depth.shape != (camera.height, camera.width):
        raise InvalidInputError(
            f"depth: has the shape {depth.shape}; allowed is the camera's, ({camera.height}, {camera.width})."
        )


def expected_picture(object_model: ObjectModel, X_CO: FloatArray, picture: DepthPicture) -> DepthPicture:
    """What the same camera would see of the object alone at a pose X_CO (3, 4), the same pixels being the hand's."""
    vertices = transform_points(X_CO[None], object_model.vertices)[0]
    inverse_depth = inverse_depths(vertices, object_model.faces, picture.camera.at_origin).astype(np.float64)
    depth = np.divide(1.0, inverse_depth, out=np.full_like(inverse_depth, np.inf), where=inverse_depth > 0.0)
    return DepthPicture(depth, picture.hand, picture.camera)


def fit_to_picture(picture: DepthPicture, object_model: ObjectModel, X_CO: FloatArray) -> PictureFit:
    """How a picture agrees with the object at a pose; the rim of its image, where the pixels decide, is left out.

    Args:
        picture: what is seen.
        object_model: the object.
        X_CO: its pose in the camera, shape (3, 4).
    """
    image = expected_picture(object_model, X_CO, picture).depth
    inner, apart = binary_erosion(np.isfinite(image)), _disagreement(picture, image)
    if not inner.any():
        return PictureFit(1.0, 0.0, 0.0, apart)
    expected, seen = image[inner], picture.depth[inner]
    margin = _margin(expected, picture.camera)
    hidden = (seen < expected - margin) | picture.hand[inner]
    if hidden.all():
        return PictureFit(1.0, 0.0, 0.0, apart)
    beyond = np.clip(seen[~hidden] - expected[~hidden], 0.0, object_model.size)
    through = beyond > margin[~hidden]
    return PictureFit(float(np.mean(hidden)), float(np.mean(through)), float(np.sqrt(np.mean(beyond**2))), apart)


def _disagreement(picture: DepthPicture, image: FloatArray) -> float:
    """Of the object's own image (height, width), see `PictureFit`."""
    either = (np.isfinite(image) | np.isfinite(picture.depth)) & ~picture.hand
    if not either.any():
        return _DISAGREEMENT
    expected, seen = image[either], picture.depth[either]
    both = np.isfinite(expected) & np.isfinite(seen)
    apart = np.full(len(seen), _DISAGREEMENT)
    apart[both] = np.minimum(np.abs(expected[both] - seen[both]), _DISAGREEMENT)
    return float(apart.mean())


def _margin(depth: FloatArray, camera: DepthCameraModel) -> FloatArray:
    margin: FloatArray = _MARGIN + 3.0 * camera.depth_noise * depth**2
    return margin
