"""The page of a checked hand, read in a real browser."""

import dataclasses
from pathlib import Path

import pytest

from tactopose_drake.cli.hand_page import save_hand_page
from tactopose_drake.hand.findings import Finding
from tactopose_drake.hand.hand_check import check_hand
from tests.browser import CHROMIUM, Browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium")

_LABELS = (
    "[...document.querySelectorAll('.tp-label')].filter((at) => at.style.display !== 'none').map((at) => at.innerText)"
)


def test_a_hands_page_names_its_frames_and_says_what_was_found(tmp_path: Path) -> None:
    check = check_hand("shadow_like")
    path_note = Finding("model", "Drake says: /a/long" + 20 * "/path" + ".urdf: a warning", "note")
    check = dataclasses.replace(check, findings=(*check.findings, path_note))
    save_hand_page(tmp_path / "hand.html", "models/shadow_like.hand.yaml", check)
    assert (tmp_path / "hand.html").stat().st_size < 6e6
    with Browser() as browser:
        browser.open(tmp_path / "hand.html")
        assert browser.evaluate("document.title") == "The hand shadow_like: frames and fingertips"
        text = browser.evaluate("document.getElementById('tp-side').innerText")
        assert "It can be used. Faults: 0" in text
        assert all(finding.part in text for finding in check.findings)
        assert {"P", "S thumb", "F thumb", "S little"} <= set(browser.evaluate(_LABELS))
        for width, height in ((1400, 900), (800, 600)):
            browser.open(tmp_path / "hand.html", width, height)
            side = (
                "(() => { const at = document.getElementById('tp-side'); return at.scrollWidth <= at.clientWidth; })()"
            )
            assert browser.evaluate(side)
        entry = "[...document.querySelectorAll('.tp-legend li')].find((li) => li.innerText.startsWith('sensor frames'))"
        browser.evaluate(f"{entry}.querySelector('input').click()")
        assert browser.screenshot().shape == (600, 800, 3)
        assert not [name for name in browser.evaluate(_LABELS) if name.startswith("S ")]
        assert browser.errors == []
