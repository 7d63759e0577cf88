"""Positions of the labels of a picture: beside their anchors, inside the picture, without overlap."""

import itertools
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.validation import FloatArray

# Width of a letter, margin and height of a line of bold text of 10 points at 100 dots per inch, pixels.
_LETTER, _MARGIN, _LINE = 9.1, 3.0, 14.0
_BESIDE = 10.0  # offset of a label from its anchor, pixels
_TO_THE_LEFT = 0.6  # labels of anchors beyond this share of the picture's width are to the left of them
_EDGE = 4.0  # distance from the picture's edges, pixels


def label_places(anchors: Sequence[FloatArray], texts: Sequence[str], width: float, dpi: float) -> list[FloatArray]:
    """The lower left corners of labels in a picture, pixels.

    A label is to the right of its anchor, or to the left if the anchor is near the right edge, and is moved up line by
    line until it overlaps none of the labels before it.

    Args:
        anchors: points to label, each (2,): to the right and down, pixels.
        texts: the labels, one for each anchor, in bold letters of 10 points.
        width: width of the picture, pixels.
        dpi: dots per inch.
    """
    scale = dpi / 100.0
    line = scale * _LINE
    placed: list[tuple[float, float, float]] = []
    for (x, y), text in zip(anchors, texts, strict=True):
        wide = scale * (_LETTER * len(text) + _MARGIN)
        left = x - scale * _BESIDE - wide if x > _TO_THE_LEFT * width else x + scale * _BESIDE
        left = min(max(left, scale * _EDGE), width - wide - scale * _EDGE)
        heights = (y - scale * _BESIDE - steps * line for steps in itertools.count())
        bottom = next(height for height in heights if not any(_overlap((left, height, wide), p, line) for p in placed))
        placed.append((left, bottom, wide))
    return [np.array(place[:2]) for place in placed]


def _overlap(one: tuple[float, float, float], other: tuple[float, float, float], line: float) -> bool:
    """Whether two lines of text, each given by its left, bottom and width, overlap."""
    (left, bottom, wide), (its_left, its_bottom, its_wide) = one, other
    return abs(bottom - its_bottom) < line and left < its_left + its_wide and its_left < left + wide
