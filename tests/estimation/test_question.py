import copy
import pickle
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tests.estimation.test_estimates import weighed


@pytest.fixture(scope="module")
def estimate() -> tp.PoseEstimate:
    model = tp.ObjectModel.from_mesh(trimesh.creation.box((0.05, 0.06, 0.07)), samples=300, cache=False)
    touch = tp.Contacts([[0.025, 0, 0], [0, 0.03, 0], [0, 0, 0.035]], np.eye(3), np.eye(3))
    return tp.estimate_pose(model, touch)


def test_an_estimate_knows_what_was_asked_and_hands_it_on(estimate: tp.PoseEstimate) -> None:
    assert estimate.question is not None
    assert len(estimate.question.evidence.contacts) == 3
    kept = estimate.keep([True] + [False] * (len(estimate.hypotheses) - 1))
    assert kept.question is estimate.question
    assert copy.deepcopy(estimate).question is estimate.question


def test_a_pickle_is_small_and_does_not_hold_the_object(estimate: tp.PoseEstimate) -> None:
    data = pickle.dumps(estimate)
    assert len(data) < 2000 * (1 + len(estimate.hypotheses))
    restored = pickle.loads(data)
    assert restored.question is None
    assert restored.best.cost == estimate.best.cost


def test_an_estimate_saves_its_page(estimate: tp.PoseEstimate, tmp_path: Path) -> None:
    estimate.save_html(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Not determined by the touch" in page
    assert page.count('class="tp-status') == 1
    assert 'src="http' not in page


def test_show_opens_the_page_in_the_browser(estimate: tp.PoseEstimate, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setenv("DISPLAY", ":0")
    path = estimate.show()
    assert path is not None
    assert opened == [path.as_uri()]
    assert "<title>" in path.read_text()
    path.unlink()
    path.parent.rmdir()


def test_show_stands_below_the_cell_of_a_notebook(estimate: tp.PoseEstimate, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    notebook = SimpleNamespace(HTML=str, display=shown.append)
    monkeypatch.setitem(sys.modules, "ipykernel", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "IPython.display", notebook)
    assert estimate.show() is None
    (frame,) = shown
    assert frame.startswith('<iframe srcdoc="&lt;!DOCTYPE html&gt;')
    assert "<title>" not in frame  # It is escaped, all of it.


def test_a_notebook_shows_a_small_table_and_a_picture(estimate: tp.PoseEstimate) -> None:
    shown = estimate._repr_html_()
    assert f"<b>{estimate.status}</b>" in shown
    assert shown.count("<tr>") == 1 + min(len(estimate.hypotheses), 5)
    assert "data:image/png;base64," in shown
    assert len(shown) < 250_000


def test_an_estimate_from_elsewhere_shows_its_table_alone(tmp_path: Path) -> None:
    foreign = weighed(0.7, 0.3)
    shown = foreign._repr_html_()
    assert "70.0%" in shown
    assert "<img" not in shown
    for save in (foreign.save_html, lambda path: tp.save_picture(path, foreign)):
        with pytest.raises(tp.TactoposeError, match="must hold the inputs it was made from"):
            save(tmp_path / "page.html")
