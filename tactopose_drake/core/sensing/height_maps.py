"""Height maps of camera-based tactile sensors (GelSight, DIGIT), reduced to patches of a few cells.

Such a sensor measures at many thousands of pixels how deep its gel is pressed in. Neighbouring pixels have nearly the
same value, with common errors, so their means over square blocks retain the information: as many blocks as a search can
afford where the gel is touched, all blocks around, and some of the rest, which tell where the object is not.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactopose_drake.core.geometry_checks import pose_matrix
from tactopose_drake.core.sensing.pad_values import DEEPEST
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.validation import FloatArray, number_array, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError

_MOST_PIXELS = 10**8
_LEAST_ALPHA = 1e-13  # m/Pa: with less, a depth would correspond to more pressure than a patch accepts


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeightMapSensor:
    """The interpretation of height maps of a flat pad.

    Frame T: its origin is at the centre of the image on the undeformed gel's surface; x along a row of the image, y
    along a column, and z out of the finger; right-handed as seen by the camera behind the gel.

    Attributes:
        pixel: size of a pixel on the gel along a row and along a column, m; or one number for both.
        least_depth: mean depth below which a block is not touched, m; well above the map's noise.
        most_depth: largest depth that the gel can show, m; a block at this depth may be deeper.
        alpha: depth over pressure of the gel, m/Pa, which converts depths to the patch's pressures. It affects how they
            are drawn, but no estimate.
        most_cells: approximate number of touched blocks that are kept; of the others, up to about twice as many.

    Raises:
        InvalidInputError: a number out of its range.
    """

    pixel: float | tuple[float, float] | list[float]
    least_depth: float = 5e-5
    most_depth: float = 0.004
    alpha: float = 2e-8
    most_cells: int = 64

    def __post_init__(self) -> None:
        if isinstance(self.pixel, list | tuple) and len(self.pixel) != 2:
            raise InvalidInputError(
                f"HeightMapSensor.pixel must be one number, or two, along rows and along columns, not {self.pixel}."
            )
        for size in self.pixel_size:
            positive_number("HeightMapSensor.pixel", size, most=0.01)
        positive_number("HeightMapSensor.least_depth", self.least_depth)
        positive_number("HeightMapSensor.most_depth", self.most_depth, most=DEEPEST)
        positive_number("HeightMapSensor.alpha", self.alpha, least=_LEAST_ALPHA, most=1.0)
        whole_number("HeightMapSensor.most_cells", self.most_cells, least=8, most=10_000)
        if self.most_depth <= self.least_depth:
            raise InvalidInputError(
                f"HeightMapSensor.most_depth must be a number > least_depth = {self.least_depth:g}, not "
                f"{self.most_depth:g}."
            )

    @property
    def pixel_size(self) -> tuple[float, float]:
        """Size along a row and along a column, m."""
        if isinstance(self.pixel, list | tuple):
            along_rows, along_columns = self.pixel
            return along_rows, along_columns
        return self.pixel, self.pixel

    def patch(self, depth: ArrayLike, X_PT: object, mask: ArrayLike | None = None) -> Patch:
        """Converts a height map to a patch, as `estimate_pose(patches=...)` takes it.

        Args:
            depth: how deep the gel is pressed in at each pixel, shape (rows, columns), m; NaN if unknown.
            X_PT: the pad's pose in the palm, a RigidTransform or shape (3, 4).
            mask: where the object touches, booleans of shape (rows, columns); depths elsewhere count as 0. Without a
                mask all depths count.

        Raises:
            InvalidInputError: shapes that do not fit, a map with no or hardly any known pixel, depths that are infinite
                or evidently not in metres, or an invalid pose.
        """
        depth = _checked(depth, mask)
        X_PT = pose_matrix("X_PT", X_PT)
        touched = np.count_nonzero(depth > self.least_depth)
        width = min(max(1, math.ceil(math.sqrt((touched or depth.size) / self.most_cells))), *depth.shape)
        blocks = _block_means(depth, width)
        chosen = _worth_keeping(blocks > self.least_depth, self.most_cells)
        if np.isnan(blocks[chosen]).all():
            raise InvalidInputError(
                "depth must be mostly known somewhere, not only at scattered pixels, "
                f"{np.count_nonzero(~np.isnan(depth))} of {depth.size}."
            )
        along_rows, along_columns = self.pixel_size
        x, y = _middles(depth.shape[1], width) * along_rows, _middles(depth.shape[0], width) * along_columns
        rows, columns = np.nonzero(chosen)
        p_TC = np.stack([x[columns], y[rows], np.zeros(len(rows))], axis=1)
        return describe_patch(
            p_TC @ X_PT[:, :3].T + X_PT[:, 3],
            blocks[chosen] / self.alpha,
            alpha=self.alpha,
            n_PT=np.tile(X_PT[:, 2], (len(rows), 1)),
            threshold=self.least_depth / self.alpha,
            saturation=self.most_depth / self.alpha,
        )


def _checked(depth: ArrayLike, mask: ArrayLike | None) -> FloatArray:
    """Depths (rows, columns), clipped at 0, and 0 outside the mask."""
    values = number_array("depth", depth, (None, None))
    if not 0 < values.size <= _MOST_PIXELS:
        raise InvalidInputError(f"depth must have 1 to {_MOST_PIXELS:g} pixels, not {values.size}.")
    if mask is not None:
        touches = np.asarray(mask)
        if touches.dtype != np.bool_ or touches.shape != values.shape:
            raise InvalidInputError(
                f"mask must be booleans of shape {values.shape}, not {touches.dtype} of shape {touches.shape}."
            )
        values = np.where(touches | np.isnan(values), values, 0.0)
    deepest = np.nanmax(np.abs(values), initial=0.0)
    if not deepest <= DEEPEST:
        raise InvalidInputError(f"depth must be numbers from {-DEEPEST:g} to {DEEPEST:g} m, or NaN, not {deepest:g} m.")
    if np.isnan(values).all():
        raise InvalidInputError("depth must be known at one pixel or more, but is NaN everywhere.")
    return np.maximum(values, 0.0)


def _middles(length: int, width: int) -> FloatArray:
    """Positions of the blocks' centres along one side of a map, relative to the map's centre, in pixels."""
    count, first = length // width, (length % width) // 2
    return np.asarray(first + width * (np.arange(count) + 0.5) - 0.5 * length, dtype=np.float64)


def _block_means(depth: FloatArray, width: int) -> FloatArray:
    """Means over blocks of `width` pixels each way, as in `_middles`; NaN if most of their pixels are."""
    rows, columns = (length // width for length in depth.shape)
    top, left = ((length % width) // 2 for length in depth.shape)
    inner = depth[top : top + rows * width, left : left + columns * width]
    known = ~np.isnan(inner)
    blocks = (rows, width, columns, width)
    counts = known.reshape(blocks).sum(axis=(1, 3))
    sums = np.where(known, inner, 0.0).reshape(blocks).sum(axis=(1, 3))
    means: FloatArray = np.where(2 * counts >= width * width, sums / np.maximum(counts, 1), np.nan)
    return means


def _worth_keeping(touched: NDArray[np.bool_], most: int) -> NDArray[np.bool_]:
    """The blocks that are touched, those around them, and a regular subset of about `most` of the others.

    If few are touched, fewer of the others are kept, because `Patch.half_pitch` is a median over all cells.
    """
    near = np.lib.stride_tricks.sliding_window_view(np.pad(touched, 1), (3, 3)).any(axis=(2, 3))
    if near.any():
        most = max(1, min(most, int(np.count_nonzero(near)) // 2))
    step = max(1, math.ceil(math.sqrt(np.count_nonzero(~near) / most)))
    sparse = np.zeros_like(touched)
    sparse[step // 2 :: step, step // 2 :: step] = True
    return near | sparse
