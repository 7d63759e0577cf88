"""The page of an estimate in numbers, without a browser."""

import dataclasses
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization.appearance import UNCERTAINTY
from tactopose_drake.visualization.estimate_page import estimate_meshcat, page_of
from tactopose_drake.visualization.page import save_html
from tactopose_drake.visualization.picture import _handle
from tactopose_drake.visualization.scene import Scene
from tactopose_drake.visualization.viewpoint import choose_view, points_of_interest


def test_the_view_goes_with_the_palm(scene: Scene, estimate: PoseEstimate) -> None:
    X_WP = RigidTransform(RollPitchYaw(0.7, -0.4, 2.1), [0.4, -0.3, 0.9])
    page = page_of(scene, estimate, X_WP=X_WP)
    np.testing.assert_allclose(page.direction_W, X_WP.rotation() @ choose_view(scene), atol=1e-12)
    p_WQ = X_WP.multiply(points_of_interest(scene).T).T
    # Of all points the outermost are among the few.
    for direction in np.concatenate([np.eye(3), -np.eye(3)]):
        assert (page.p_WQ @ direction).max() > (p_WQ @ direction).max() - 0.01


def test_the_legend_says_where_regions_are_cut_off(scene: Scene, estimate: PoseEstimate) -> None:
    """At a quarter of the can's size: what is drawn looks surer than a covariance of decimetres is."""
    best, size = scene.hypotheses[0], scene.model.size
    wide = dataclasses.replace(best, covariance=np.diag(np.square([0.02] * 3 + [0.1] * 3)))
    for shown, said in ((best, ""), (wide, f"; cut off at {250.0 * size:.0f} mm")):
        told = dataclasses.replace(scene, hypotheses=(shown,))
        (switch,) = (switch for switch in page_of(told, estimate).switches if switch.look is UNCERTAINTY)
        assert (switch.detail or UNCERTAINTY.meaning) == UNCERTAINTY.meaning + said
        label = str(_handle(UNCERTAINTY, told, "").get_label())
        assert label == UNCERTAINTY.name + (f" ({said[2:]})" if said else "")


def test_a_page_names_a_file_whose_name_is_no_utf8(scene: Scene, estimate: PoseEstimate, tmp_path: Path) -> None:
    model = dataclasses.replace(scene.model, name="t\udcfcte")  # As Python reads a name in Latin-1.
    page = page_of(dataclasses.replace(scene, model=model), estimate)
    save_html(tmp_path / "page.html", estimate_meshcat(scene), page)
    assert r"T\udcfcte" in (tmp_path / "page.html").read_text(encoding="utf-8")
