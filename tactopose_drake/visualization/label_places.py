"""Where the texts of a picture stand: beside what they name, whole, and none over another."""

import itertools
from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.validation import FloatArray

# Of bold letters of 10 points at 100 dots an inch, pixels.
_LETTER, _MARGIN, _LINE = 9.1, 3.0, 14.0
_BESIDE = 10.0  # of a text from what it names, pixels
_TO_THE_LEFT = 0.6  # of a picture's width, beyond which a text stands to the left
_EDGE = 4.0  # pixels


def label_places(anchors: Sequence[FloatArray], texts: Sequence[str], width: float, dpi: float) -> list[FloatArray]:
    """Where the texts' lower left corners stand in a picture, pixels.

    A text is to the right of what it names, or to the left of it near the right edge, and as many lines higher as the
    texts before it ask for.

    Args:
        anchors: what is named, to the right and down, shape (2,) each, pixels.
        texts: one for each, in bold letters of 10 points.
        width: of the picture, pixels.
        dpi: dots an inch.
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
    """Whether two lines of text do, by left, bottom and width."""
    (left, bottom, wide), (its_left, its_bottom, its_wide) = one, other
    return abs(bottom - its_bottom) < line and left < its_left + its_wide and its_left < left + wide
