import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from tactopose_drake.visualization.label_places import label_places

WIDTH = 700.0


@pytest.mark.parametrize("dpi", [60, 100])
def test_texts_stand_whole_in_the_picture_and_none_over_another(dpi: int) -> None:
    generator = np.random.default_rng(0)
    width = WIDTH * dpi / 100
    texts = ["1", "2", "3", "turn about the object's z", "slide along the object's (0.50, 0.50, 0.71)", "P"] * 2
    renderer = FigureCanvasAgg(Figure(dpi=dpi)).get_renderer()
    font = FontProperties(size=10, weight="bold")
    sizes = [renderer.get_text_width_height_descent(text, font, ismath=False)[:2] for text in texts]
    for _ in range(20):
        anchors = list(generator.uniform([0.0, 200.0], [width, 300.0], (len(texts), 2)))
        places = label_places(anchors, texts, width, dpi)
        boxes = [(left, bottom, *size) for (left, bottom), size in zip(places, sizes, strict=True)]
        assert all(left >= 0.0 and left + wide <= width for left, _, wide, _ in boxes)
        for (left, bottom, wide, high), (left_2, bottom_2, wide_2, high_2) in itertools.combinations(boxes, 2):
            beside = left + wide <= left_2 or left_2 + wide_2 <= left
            assert beside or abs(bottom - bottom_2) >= max(high, high_2) - 1.0


def test_a_text_is_beside_what_it_names_and_on_the_left_near_the_right_edge() -> None:
    anchors = [np.array([100.0, 100.0]), np.array([650.0, 300.0])]
    (left, bottom), (left_2, bottom_2) = label_places(anchors, ["1", "2"], WIDTH, 100)
    assert 100.0 < left < 120.0
    assert 620.0 < left_2 < 650.0
    assert (bottom, bottom_2) == (90.0, 290.0)
