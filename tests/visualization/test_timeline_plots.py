"""The curves of a recording's page, as they are drawn."""

import re

import numpy as np
import pytest

from tactopose_drake.visualization.timeline import Curve, Plot, Timeline, timeline_html


def points(text: str) -> list[np.ndarray]:
    """Of each line, to the right and down, shape (n, 2): of 1000 and 100 for the whole plot."""
    lines = re.findall(r'<polyline points="([^"]*)"', text)
    return [np.array([[float(x) for x in point.split(",")] for point in line.split(" ")]) for line in lines]


def test_a_curve_reaches_from_its_plots_zero_to_its_largest_value() -> None:
    times = np.array([0.5, 1.0, 2.0, 4.0])
    forces = Plot("force", "N", (Curve("thumb", np.array([0.0, 2.0, 4.0, 8.0])), Curve("first", np.full(4, 4.0))))
    width = Plot("width", "mm", (Curve("position", np.array([np.nan, 0.003, np.nan, 0.001])),))
    text = timeline_html(Timeline(times, ("held: no", "ok", "ok", "lost"), (forces, width)))
    thumb, first, *runs = points(text)
    np.testing.assert_allclose(thumb[:, 0], 1000.0 * times / 4.0)
    np.testing.assert_allclose(thumb[:, 1], [100.0, 76.0, 52.0, 4.0])
    np.testing.assert_allclose(first[:, 1], 52.0)
    assert [run.tolist() for run in runs] == [[[250.0, pytest.approx(4.0)]], [[1000.0, pytest.approx(68.0)]]]
    assert re.findall(r'<span class="tp-ticks"><i>([^<]*)</i>', text) == ["8", "0.003"]


def test_the_strip_has_a_piece_for_each_state_as_long_as_it_lasts() -> None:
    timeline = Timeline(np.array([0.0, 1.0, 2.0, 4.0]), ("ok", "ok", "lost: a", "lost: b"))
    assert timeline.pieces() == [(0.0, 2.0, "ok"), (2.0, 4.0, "lost: a"), (4.0, 4.0, "lost: b")]
    assert re.findall(r'<i style="left:([\d.]+)%;width:([\d.]+)%', timeline_html(timeline)) == [
        ("0.000", "50.000"),
        ("50.000", "50.000"),
        ("100.000", "0.000"),
    ]
