"""Images of a depth camera: noise, the hand's pixels, and how well an object's pose agrees with them.

Sources: [K12] K. Khoshelham and S. Elberink, Accuracy and resolution of Kinect depth data, Sensors, 2012.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_erosion, maximum_filter

from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray, number_array
from tactopose_drake.core.vision.rasterizer import Camera, inverse_depths
from tactopose_drake.errors import InvalidInputError

_DISAGREEMENT = 0.01  # cap on the difference of depths, m
_MARGIN = 0.004  # beyond three sigma of the noise, by which a surface must be nearer to hide another, m
_FARTHEST = 66.0  # m, beyond what 16 bits of millimetres hold: an image of larger depths alone is in millimetres


@dataclasses.dataclass(kw_only=True, slots=True)
class DepthCameraModel:
    """The geometry and noise of a depth camera with square pixels and without distortion."""

    width: int = 240  # width of the image, pixels
    height: int = 180  # height of the image, pixels
    focal_length: float = 200.0  # focal length, pixels
    # Where the camera's axis meets the image, pixels to the right of the centre of the upper left pixel, as in OpenCV
    # and ROS; null for the middle. In a cropped image it may be outside.
    center_x: float | None = None
    center_y: float | None = None  # the same, below the centre of that pixel
    depth_noise: float = 1.43e-3  # standard deviation of a depth z over z^2, 1/m: that of the Kinect [K12]
    # Share of its variance that is common to neighbouring pixels, so that averaging over the object does not reduce it.
    common_share: float = 0.3
    nearest: float = 0.1  # least depth that is measured, m
    farthest: float = 3.0  # largest depth that is measured, m

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        may_be_zero = ("depth_noise", "common_share")
        centers = ("center_x", "center_y")
        check_numbers("DepthCameraModel", self, may_be_zero=may_be_zero, any_sign=centers, most={"common_share": 1.0})
        if self.nearest >= self.farthest:
            raise InvalidInputError(
                f"DepthCameraModel.nearest must be less than `farthest`, {self.farthest:g} m, not {self.nearest:g} m."
            )

    @property
    def at_origin(self) -> Camera:
        """The camera at the origin of its own frame."""
        return Camera(np.eye(3, 4), self.focal_length, self.width, self.height, self.center)

    @property
    def center(self) -> tuple[float, float]:
        """Where the camera's axis meets the image, pixels to the right of and below its upper left corner."""
        x = 0.5 * self.width if self.center_x is None else self.center_x + 0.5
        y = 0.5 * self.height if self.center_y is None else self.center_y + 0.5
        return x, y


@dataclass(frozen=True, eq=False)
class DepthPicture:
    """A depth image of object and hand.

    Attributes:
        depth: along the camera's axis at each pixel, shape (height, width), m; infinite where nothing is seen.
        hand: whether each pixel is the hand's, as rendered from its joints, shape (height, width).
        camera: that took the image.
    """

    depth: FloatArray
    hand: NDArray[np.bool_]
    camera: DepthCameraModel

    def points(self, *, without_hand: bool) -> FloatArray:
        """The points seen, in the camera's frame, shape (n, 3), m."""
        chosen = np.isfinite(self.depth) & ~self.hand if without_hand else np.isfinite(self.depth)
        row, column = np.nonzero(chosen)
        return rays(self.camera)[row, column] * self.depth[row, column, None]


@dataclass(frozen=True)
class PictureFit:
    """The agreement of a picture with the object at a pose.

    Attributes:
        hidden_share: share of the object's pixels at which something nearer is seen, 0 to 1.
        seen_through: share of the other pixels at which something farther or nothing is seen, 0 to 1.
        misfit: rms excess of the depths seen at these other pixels over the object's, m.
        disagreement: mean absolute difference of the picture and the object's own image over the pixels of either,
            capped at a centimetre, m: places where the object should be seen and is not, and where something is seen
            that it does not explain, count as the cap.
    """

    hidden_share: float
    seen_through: float
    misfit: float
    disagreement: float


def rays(camera: DepthCameraModel) -> FloatArray:
    """The points at depth 1 m on the pixels' rays, in the camera's frame, shape (height, width, 3), m."""
    row, column = np.mgrid[: camera.height, : camera.width] + 0.5
    across, down = column - camera.center[0], row - camera.center[1]
    found: FloatArray = np.stack([across, down, np.full_like(row, camera.focal_length)], axis=2) / camera.focal_length
    return found


def noisy_depth(depth: ArrayLike, camera: DepthCameraModel, generator: np.random.Generator) -> FloatArray:
    """Adds the camera's noise to a depth image; infinite depths stay infinite.

    Args:
        depth: shape (height, width), m.
        camera: size and noise.
        generator: of the noise.

    Raises:
        InvalidInputError: if the image has another size than the camera's, or is evidently in millimetres.
    """
    depth = checked_depth("depth", depth, camera)
    row, column = np.mgrid[: camera.height, : camera.width] + 0.5
    weights = generator.normal(size=3)  # common errors: a random plane over the image
    common = weights[0] + weights[1] * (row / camera.height - 0.5) + weights[2] * (column / camera.width - 0.5)
    single = generator.normal(size=depth.shape)
    noise = math.sqrt(1.0 - camera.common_share) * single + math.sqrt(camera.common_share) * common
    seen = np.isfinite(depth)
    exact = np.where(seen, depth, 0.0)
    noisy: FloatArray = np.where(seen, exact + camera.depth_noise * exact**2 * noise, np.inf)
    return noisy


def take_picture(
    depth: ArrayLike, hand_vertices: FloatArray, hand_faces: NDArray[np.int32], camera: DepthCameraModel
) -> DepthPicture:
    """A depth image with known pixels of the hand.

    A pixel is the hand's if the hand, posed by its joints, is rendered there or beside it, and nothing is seen in front
    of it.

    Args:
        depth: shape (height, width), m; 0, infinite or NaN where nothing is seen.
        hand_vertices: in the camera's frame C, z forward, shape (v, 3), m.
        hand_faces: vertex indices, shape (f, 3).
        camera: that took the image.

    Raises:
        InvalidInputError: if the image has another size than the camera's, or is evidently in millimetres: it consists
            of whole numbers, or of depths of more than 66 m only.
    """
    depth = checked_depth("depth", depth, camera)
    seen = np.isfinite(depth) & (depth > 0.0)
    measured = np.where(seen, depth, np.inf)
    hand = maximum_filter(inverse_depths(hand_vertices, hand_faces, camera.at_origin), size=3)
    finite = np.where(seen, measured, 0.0)
    behind = hand * (finite + _margin(finite, camera)) >= 1.0
    return DepthPicture(measured, seen & (hand > 0.0) & behind, camera)


def checked_depth(name: str, depth: ArrayLike, camera: DepthCameraModel) -> FloatArray:
    """An image of a camera's size, shape (height, width), m, which is refused if evidently in millimetres."""
    given = number_array(name, depth, (None, None))
    if given.shape != (camera.height, camera.width):
        raise InvalidInputError(
            f"{name} must have the camera's shape, ({camera.height}, {camera.width}), not {given.shape}."
        )
    if np.asarray(depth).dtype.kind in "iu":
        raise InvalidInputError(
            f"{name} must consist of floats, m, not of whole numbers. Multiply by 0.001 what is in millimetres."
        )
    seen = given[np.isfinite(given) & (given > 0.0)]
    if len(seen) and seen.min() > _FARTHEST:
        raise InvalidInputError(
            f"{name} must be in metres, but nothing in it is nearer than {seen.min():g} m. Multiply by 0.001 what is "
            "in millimetres."
        )
    return given


def expected_picture(object_model: ObjectModel, X_CO: FloatArray, picture: DepthPicture) -> DepthPicture:
    """The image of the object alone at a pose X_CO (3, 4) by the same camera, with the same pixels of the hand."""
    vertices = transform_points(X_CO[None], object_model.vertices)[0]
    inverse_depth = inverse_depths(vertices, object_model.faces, picture.camera.at_origin).astype(np.float64)
    depth = np.divide(1.0, inverse_depth, out=np.full_like(inverse_depth, np.inf), where=inverse_depth > 0.0)
    return DepthPicture(depth, picture.hand, picture.camera)


def fit_to_picture(picture: DepthPicture, object_model: ObjectModel, X_CO: FloatArray) -> PictureFit:
    """The agreement of a picture with the object at a pose; ambiguous pixels at the rim of its image are left out.

    Args:
        picture: the depth image.
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
    """The disagreement with the object's own image (height, width), see `PictureFit`."""
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
