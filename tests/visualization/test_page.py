"""Pages, read in a real browser without a network."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization.estimate_page import estimate_meshcat, page_of
from tactopose_drake.visualization.page import save_html
from tactopose_drake.visualization.scene import Scene, ShownHypothesis
from tests.browser import CHROMIUM, Browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium")


@pytest.fixture(scope="module")
def path(scene: Scene, estimate: PoseEstimate, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "page.html"
    save_html(path, estimate_meshcat(scene), page_of(scene, estimate))
    return path


def switch(browser: Browser, name: str) -> str:
    """The expression of a legend's box."""
    entry = f"[...document.querySelectorAll('.tp-legend li')].find((li) => li.innerText.startsWith({name!r}))"
    assert browser.evaluate(f"!!{entry}"), name
    return f"{entry}.querySelector('input')"


def pane(browser: Browser) -> np.ndarray:
    """What is seen of the scene alone."""
    return browser.screenshot()[:, : browser.evaluate("document.getElementById('meshcat-pane').offsetWidth")]


def differs(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Which pixels differ well, shape (height, width)."""
    return np.abs(before - after).max(axis=2) > 0.06


def changed(before: np.ndarray, after: np.ndarray) -> int:
    """How many do."""
    return int(np.count_nonzero(differs(before, after)))


def test_the_page_says_what_it_is_and_what_is_believed(browser: Browser, path: Path) -> None:
    browser.open(path)
    assert browser.evaluate("document.title") == "A <b>can</b> in the hand: pose by touch"
    text = browser.evaluate("document.getElementById('tp-side').innerText")
    assert browser.evaluate("viewer.gui.domElement.style.right") == "var(--side)"  # beside the panel, not under it
    for said in (
        "A <b>can</b> in the hand",
        "ambiguous",
        "Not determined by the touch: turn about the object's z.",
        "Probably not of this object: contact 2.",
        "60.0%",
        "the longest is 3.0 N",
    ):
        assert said in text
    assert browser.errors == []
    assert browser.requests == []
    assert path.stat().st_size < 6e6


def test_the_legend_names_what_is_seen_and_no_more(browser: Browser, path: Path, scene: Scene) -> None:
    browser.open(path)
    names = browser.evaluate(
        "[...document.querySelectorAll('.tp-legend li')].map((li) => li.innerText.split('\\n')[0].trim())"
    )
    looks = dataclasses.replace(scene, frames=True).looks
    assert names == [*(look.name for look in looks), "see through the hand"]


def test_frames_and_friction_cones_are_shown_on_request(
    browser: Browser, scene: Scene, estimate: PoseEstimate, tmp_path: Path
) -> None:
    rubbed = dataclasses.replace(scene, friction=0.6)
    save_html(tmp_path / "page.html", estimate_meshcat(rubbed), page_of(rubbed, estimate))
    browser.open(tmp_path / "page.html", 900, 700)
    names = "[...document.querySelectorAll('.tp-label')].filter((at) => !at.style.display).map((at) => at.innerText)"
    for name in ("frames", "friction cones"):
        box, before = switch(browser, name), pane(browser)
        assert not browser.evaluate(f"{box}.checked")
        browser.evaluate(f"{box}.click()")
        assert changed(before, pane(browser)) > 200, name
    assert {"P", "O"} <= set(browser.evaluate(names))


def test_a_contact_behind_the_object_shines_through_it(
    browser: Browser, scene: Scene, estimate: PoseEstimate, tmp_path: Path
) -> None:
    # One on each side: one of them is behind, from wherever it is seen.
    touch = Contacts([[0.03, 0, 0.01], [-0.03, 0, 0.01], [0, 0.03, 0.01], [0, -0.03, 0.01]])
    bare = Scene(model=scene.model, contacts=touch, hypotheses=(ShownHypothesis(RigidTransform()),))
    save_html(tmp_path / "page.html", estimate_meshcat(bare), page_of(bare, estimate))
    browser.open(tmp_path / "page.html", 900, 700)
    browser.evaluate("document.querySelectorAll('.tp-label').forEach((label) => { label.style.opacity = 0; })")
    for row in range(4):
        before = pane(browser)
        ball = f"viewer.scene_tree.find(['tactopose', 'touch', '{row}']).object"
        browser.evaluate(f"{ball}.visible = false; viewer.set_dirty();")
        assert changed(before, pane(browser)) > 100, row


def test_pressed_cells_are_seen_within_the_object(
    browser: Browser, scene: Scene, estimate: PoseEstimate, tmp_path: Path
) -> None:
    p_PT = [[0.027, y, z] for y in (-0.005, 0.005, 0.015) for z in (-0.005, 0.005)]
    patch = describe_patch(p_PT, np.full(6, 5e4), alpha=1e-8, n_PT=np.tile([-1.0, 0.0, 0.0], (6, 1)))
    pressed = Scene(
        model=scene.model, contacts=Contacts.empty(), patches=(patch,), hypotheses=(ShownHypothesis(RigidTransform()),)
    )
    save_html(tmp_path / "page.html", estimate_meshcat(pressed), page_of(pressed, estimate))
    browser.open(tmp_path / "page.html", 900, 700)
    before = pane(browser)
    browser.evaluate(f"{switch(browser, 'pressed cells')}.click()")
    assert changed(before, pane(browser)) > 300
    browser.evaluate(f"{switch(browser, 'estimate')}.click(); {switch(browser, 'patch axes')}.click()")
    hidden = pane(browser)
    browser.evaluate(f"{switch(browser, 'patch axes')}.click()")
    assert changed(hidden, pane(browser)) > 20


def test_the_legends_hypotheses_are_those_of_the_table(browser: Browser, path: Path) -> None:
    browser.open(path)
    group, rows = switch(browser, "another hypothesis"), "[...document.querySelectorAll('#tp-side td input')]"
    checked = f"[{group}.checked, ...{rows}.map((box) => box.checked)]"
    assert browser.evaluate(checked) == [True, True, True]
    browser.evaluate(f"{group}.click()")
    assert browser.evaluate(checked) == [False, False, False]
    browser.evaluate(f"{rows}[1].click()")
    assert browser.evaluate(checked) == [True, False, True]


def test_labels_do_not_cover_each_other(browser: Browser, scene: Scene, estimate: PoseEstimate, tmp_path: Path) -> None:
    near = Contacts([[0.03, 0, 0.01], [0.03, 0.001, 0.01], [0.03, 0, 0.011]], [[1, 0, 0]] * 3)
    crowded = dataclasses.replace(scene, contacts=near)
    save_html(tmp_path / "page.html", estimate_meshcat(crowded), page_of(crowded, estimate))
    browser.open(tmp_path / "page.html")
    tops = browser.evaluate(
        "[...document.querySelectorAll('.tp-label')].slice(0, 3).map((at) => at.getBoundingClientRect().y)"
    )
    assert min(np.diff(np.sort(tops))) > 8


def test_each_switch_shows_and_hides_something(browser: Browser, path: Path, scene: Scene) -> None:
    browser.open(path, 900, 700)
    shown = pane(browser)
    for look in scene.looks:
        box = switch(browser, look.name)
        browser.evaluate(f"{box}.click()")
        # A normal under its force is a hair that sticks out.
        assert changed(shown, pane(browser)) > 5, look.name
        browser.evaluate(f"{box}.click()")
        assert changed(shown, pane(browser)) == 0, look.name


def test_a_hypothesis_has_a_switch_of_its_own(browser: Browser, path: Path) -> None:
    browser.open(path, 900, 700)
    shown = pane(browser)
    boxes = "document.querySelectorAll('#tp-side td input')"
    assert browser.evaluate(f"{boxes}.length") == 2
    counts = []
    for row in range(2):
        browser.evaluate(f"{boxes}[{row}].click()")
        counts.append(changed(shown, pane(browser)))
        browser.evaluate(f"{boxes}[{row}].click()")
    assert min(counts) > 1000


def test_other_hypotheses_do_not_blend_with_the_estimate(browser: Browser, path: Path) -> None:
    browser.open(path, 900, 700)
    shown, where = pane(browser), {}
    for name in ("estimate", "another hypothesis"):
        browser.evaluate(f"{switch(browser, name)}.click()")
        where[name] = differs(shown, pane(browser))
        browser.evaluate(f"{switch(browser, name)}.click()")
    both = where["estimate"] & where["another hypothesis"]
    assert np.count_nonzero(both) < 0.02 * np.count_nonzero(where["another hypothesis"])


def test_a_more_probable_hypothesis_is_more_opaque(browser: Browser, path: Path) -> None:
    browser.open(path)
    at = "viewer.scene_tree.find(['tactopose', 'alternatives', '{}', '<object>']).object.material.opacity"
    first, second = (browser.evaluate(at.format(row)) for row in range(2))
    assert 0.1 < second < first < 0.7


def test_the_contacts_are_numbered_in_the_scene(browser: Browser, path: Path) -> None:
    browser.open(path)
    labels = browser.evaluate(
        "[...document.querySelectorAll('.tp-label')].filter((at) => at.style.display !== 'none')"
        ".map((at) => [at.innerText, at.getBoundingClientRect().x, at.getBoundingClientRect().y])"
    )
    assert [text for text, _, _ in labels] == ["1", "2", "3", "turn about the object's z"]
    width = browser.evaluate("document.getElementById('meshcat-pane').offsetWidth")
    assert all(0 <= x < width and 0 <= y < 900 for _, x, y in labels)


def test_an_estimate_at_the_truth_does_not_fight_with_it(
    browser: Browser, scene: Scene, estimate: PoseEstimate, tmp_path: Path
) -> None:
    alone = dataclasses.replace(scene, hypotheses=scene.hypotheses[:1], prior=None, hand=None, truth=RigidTransform())
    save_html(tmp_path / "page.html", estimate_meshcat(alone), page_of(alone, estimate))
    browser.open(tmp_path / "page.html", 900, 700)
    for name in ("95 % region", "not determined"):
        browser.evaluate(f"{switch(browser, name)}.click()")
    both = pane(browser)
    browser.evaluate(f"{switch(browser, 'true pose')}.click()")
    of_truth = changed(both, pane(browser))
    browser.evaluate(f"{switch(browser, 'true pose')}.click()")
    browser.evaluate(f"{switch(browser, 'estimate')}.click()")
    of_estimate = changed(both, pane(browser))
    # Its wires cross the estimate, and no more.
    assert 200 < of_truth < 0.12 * of_estimate


def test_there_is_light_and_dark(browser: Browser, path: Path) -> None:
    for theme, other in (("light", "dark"), ("dark", "light")):
        browser.open(path, 900, 700, theme)
        before = browser.screenshot()[5:20, 5:20].mean()
        assert (before > 0.5) == (theme == "light")
        browser.evaluate("document.getElementById('tp-theme').click()")
        assert browser.evaluate("document.documentElement.dataset.theme") == other
        assert (browser.screenshot()[5:20, 5:20].mean() > 0.5) == (other == "light")


def test_regions_stand_out_from_a_light_and_a_dark_ground(browser: Browser, path: Path) -> None:
    region = "viewer.scene_tree.find(['tactopose', 'estimate', 'uncertainty', '0', 'ball', '<object>']).object"
    for theme in ("light", "dark"):
        browser.open(path, 900, 700, theme)
        assert (browser.evaluate(f"{region}.material.color.g") > 0.3) == (theme == "dark")


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (800, 600)])
def test_nothing_is_cut_off(browser: Browser, path: Path, width: int, height: int) -> None:
    browser.open(path, width, height)
    assert browser.evaluate(
        "(() => { const side = document.getElementById('tp-side'); return side.scrollWidth <= side.clientWidth; })()"
    )
    # What is framed lies within the pane: its border shows the background alone.
    shown = pane(browser)
    for border in (shown[:, 2], shown[:, -3]):
        assert np.abs(border - border.mean(axis=1, keepdims=True)).max() < 0.08
