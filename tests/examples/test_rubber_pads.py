"""The study of rubber pads: what it makes of presses, and the hands that it writes."""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tactopose_drake.core.shape.model_cache import FOLDER_VARIABLE
from tactopose_drake.hand import find_alpha, load_hand_config, load_tactile_pad


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "examples" / "thesis"))
        return importlib.import_module("rubber_pads")


def test_presses_keep_their_force_and_cells_on_the_way_back_read_more(script: ModuleType) -> None:
    fit = find_alpha(modulus=150e3, thickness=0.003, cell=0.005)
    springs, confined, rubber, back = (
        script.pressed(fit, kind, 0.003) for kind in (script.SPRINGS, script.CONFINED, script.RUBBER, script.BACK)
    )
    for i, press in enumerate(fit.presses):
        np.testing.assert_allclose(springs[i].pressure, press.pressure, rtol=1e-6)
        assert confined[i].pressure.sum() == pytest.approx(press.pressure.sum())
        assert rubber[i].pressure.sum() < confined[i].pressure.sum()
        assert np.all(back[i].pressure >= rubber[i].pressure)
    deepest = [press.depth == max(p.depth for p in fit.presses) for press in fit.presses]
    same = [np.array_equal(a.pressure, b.pressure) for a, b in zip(rubber, back, strict=True)]
    assert all(same[i] for i in np.flatnonzero(deepest))
    assert not any(same[i] for i in np.flatnonzero(~np.array(deepest)))


def test_the_hand_that_is_written_has_pads_of_rubber(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    hand = load_hand_config(script.write_hand(script.RUBBER))
    for pad in hand.pads:
        rubber = load_tactile_pad(pad.array).model.rubber
        assert rubber is not None
        assert rubber.half_pressure == 100e3
        assert rubber.confinement == pytest.approx(0.0388, abs=1e-4)  # 13 times the layer's 3 mm


def test_verdicts_say_whether_the_thesis_claim_holds(script: ModuleType) -> None:
    tilts = {
        "good": script.TiltTable(1.0, np.full((3, 4), 0.5)),
        "bad": script.TiltTable(2.0, np.full((3, 4), 3.0)),
    }
    errors = {script.PCA: np.full((2, 2), 5.0), script.DISTANCE: np.full((2, 2), 4.0), script.OURS: np.ones((2, 2))}
    good, bad, poses = script.verdicts(tilts, {"good": dict.fromkeys(script.FACTORS, errors)})
    assert 'under 1 deg" holds' in good
    assert 'under 1 deg" does NOT hold' in bad
    assert "ours is below both of the thesis' objectives" in poses
