import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import tactopose_drake as tp
from tactopose_drake.core.poses import retract, transform_points
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tests.core.balanced_forces import balanced_forces

FOLDER = Path(__file__).parents[2] / "examples" / "thesis"
X_PO = retract(np.eye(3, 4), np.array([0.3, -0.5, 1.0, 0.02, -0.05, 0.1]))


@pytest.fixture(scope="module")
def script() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        return importlib.import_module("beyond_contact")


def make_grasps(script: ModuleType, name: str, count: int) -> list[Any]:
    """Touches of the whole surface that carry the object, in place of simulated grasps."""
    scenario = script.make_scenario(name)
    model, weight_P = script.make_model(scenario), script.gravity(scenario).gravity_P
    center = transform_points(X_PO, model.center_of_mass[None])[0]
    grasps = []
    for seed in range(count):
        touch = touch_surface(model, X_PO, 5, np.random.default_rng(seed), sigma_position=0.0, sigma_normal=0.0)
        assert touch.n_PC is not None
        f_PC = balanced_forces(3.0 * touch.n_PC, touch.p_PC, center, model.mass * weight_P)
        spheres = touch.p_PC + 0.0075 * touch.n_PC, np.full(5, 0.008)
        grasps.append(script.SimulatedGrasp(X_PO, touch.p_PC, touch.n_PC, f_PC, *spheres))
    return grasps


def test_down_is_towards_the_little_finger(script: ModuleType) -> None:
    # The scenario holds the palm with the thumb's side up.
    gravity_P = script.gravity(script.make_scenario("bust")).gravity_P
    np.testing.assert_allclose(gravity_P, [-9.81, 0.0, 0.0], atol=0.05)


def test_every_kind_of_evidence_has_a_row(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "make_library", lambda name, count: make_grasps(script, name, count))
    result = CliRunner().invoke(script.main, ["--trials", "3", "--seed", "1"])
    assert result.exit_code == 0, result.output
    for title in ("The bust by points and normals, 3 grasps", "The wine glass by points alone, 3 grasps"):
        assert title in result.output
    lines = [line.split() for line in result.output.splitlines()]
    rows = [line for line in lines if line and line[0] in ("contacts", "hand", "friction", "balance")]
    assert len(rows) == 4 * 6
    shares = np.array([[float(share) for share in row[-6:-3]] for row in rows])
    assert np.all((shares >= 0.0) & (shares <= 100.0))
    # Found is at least as often as best.
    assert np.all(shares[:, 1] >= shares[:, 0])


def test_all_evidence_finds_what_the_points_alone_do_not(script: ModuleType) -> None:
    outcomes = script.study("bust", make_grasps(script, "bust", 5), 2, has_normals=False)
    success = {row: sum(run.success for run in runs) for row, runs in outcomes.items()}
    assert success["hand + friction + balance"] > success["contacts alone"]


def test_the_mass_is_the_simulations(script: ModuleType) -> None:
    model: tp.ObjectModel = script.make_model(script.make_scenario("wine_glass"))
    assert model.mass_is_known
    assert model.mass == 0.24
