"""A page of a recording, read in a real browser."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform

from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization.estimate_page import instant_of, page_of
from tactopose_drake.visualization.meshcat import draw_scene
from tactopose_drake.visualization.page import save_html
from tactopose_drake.visualization.scene import Scene
from tactopose_drake.visualization.timeline import Curve, Plot, Timeline
from tactopose_drake.visualization.touch_marks import move_touch
from tests.browser import CHROMIUM, Browser

RED, GREY = "rgb(217, 26, 51)", "rgb(128, 130, 135)"

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium")


def test_the_slider_moves_through_a_recording(
    browser: Browser, scene: Scene, estimate: PoseEstimate, tmp_path: Path
) -> None:
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    draw_scene(meshcat, scene)
    meshcat.StartRecording(1000.0)
    for step in range(21):
        meshcat.SetTransform("/tactopose/estimate", RigidTransform([0.0, 0.0, 0.002 * step]), 0.1 * step)
        is_false = scene.is_false & (step >= 10)
        move_touch(meshcat, "/tactopose/touch", scene.contacts, len(scene.contacts), 0.1 * step, is_false)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    times = np.linspace(0.1, 2.0, 20)
    states = tuple("held: below min_force" if time < 0.95 else "ok" for time in times)
    width = np.where(times < 0.95, np.nan, 3.0 - times)
    plots = (Plot("contact force", "N", (Curve("thumb", times), Curve("first", 2 * times))),)
    plots += (Plot("\u00b1 position", "mm", (Curve("position", width),)),)
    said = tuple(
        instant_of(scene, None if time < 0.95 else estimate, state) for time, state in zip(times, states, strict=True)
    )
    timeline = Timeline(times, states, plots, said)
    save_html(tmp_path / "page.html", meshcat, page_of(scene, estimate, timeline=timeline))
    browser.open(tmp_path / "page.html")
    height = "viewer.scene_tree.find(['tactopose', 'estimate']).object.position.z"
    waiting = "no new estimate: below min_force"
    # At the beginning stands, and is drawn, what is said first.
    for time, state, first in ((2.0, "ok", 2.0), (0.5, waiting, 0.5), (1.5, "ok", 1.5), (0.0, waiting, 0.1)):
        browser.evaluate(
            f"(() => {{ const at = document.getElementById('tp-time'); at.value = {time};"
            "at.dispatchEvent(new Event('input')); })()"
        )
        assert browser.evaluate(height) == pytest.approx(0.02 * first, abs=1e-4)
        assert browser.evaluate("document.getElementById('tp-now').innerText") == state
        assert browser.evaluate("document.getElementById('tp-seconds').innerText") == f"{time:.2f} s"
        text = browser.evaluate("document.getElementById('tp-said').innerText")
        assert f"At {first:.2f} s: {'ok' if state == 'ok' else 'no new estimate'}" in text
        assert ("Below min_force." in text) == (state != "ok")
        rows = browser.evaluate("document.querySelectorAll('#tp-hypotheses tr').length")
        assert rows == (4 if state == "ok" else 0)
        browser.screenshot()  # numbers are placed, and coloured, where the scene is drawn
        number = browser.evaluate("document.querySelectorAll('.tp-label')[1].style.color")
        assert number == (GREY if state == "ok" else RED)
    titles = browser.evaluate("[...document.querySelectorAll('.tp-strip i')].map((piece) => piece.title)")
    assert titles == [waiting, "ok"]
    legend = browser.evaluate("document.querySelector('.tp-legend').innerText")
    assert "the longest is the largest of the object's contacts below" in legend
    assert browser.evaluate("document.querySelectorAll('.tp-strip i').length") == 2
    assert browser.evaluate("document.querySelectorAll('.tp-plot polyline').length") == 3
    foot = browser.evaluate("document.getElementById('tp-foot').innerText")
    assert all(text in foot for text in ("contact force, N", "time, s", "thumb", "no new estimate"))
    ticks = browser.evaluate("[...document.querySelectorAll('.tp-axis i')].map((tick) => tick.innerText)")
    assert ticks == ["0", "0.5", "1", "1.5", "2"]
    browser.evaluate("document.getElementById('tp-play').click()")
    browser.wait_for(f"{height} > 0.0399")
    browser.wait_for("document.getElementById('tp-play').innerText === 'Play'")
    assert browser.errors == []
