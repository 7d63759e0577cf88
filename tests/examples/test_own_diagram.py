import contextlib
import io
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.core.poses import increments_between

SCRIPT = Path(__file__).parents[2] / "examples" / "own_diagram.py"


@pytest.fixture(scope="module")
def run() -> dict[str, Any]:
    """What the script's names stand for at its end, and what it has printed."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        names = runpy.run_path(str(SCRIPT))
    return {**names, "printed": printed.getvalue()}


def estimated(run: dict[str, Any], port: str) -> Any:
    return (
        run["estimation"]
        .GetOutputPort(port)
        .Eval(run["estimation"].GetMyContextFromRoot(run["simulator"].get_context()))
    )


def determined_error(run: dict[str, Any], X_PO: RigidTransform) -> tuple[float, float]:
    """How far a pose is from the true one, m and rad, in the directions that the touch determines."""
    free = estimated(run, "hypotheses").best.free_directions
    true, pose = run["X_PO"].GetAsMatrix34(), X_PO.GetAsMatrix34()
    increment = increments_between(true[None], pose[None])[0]
    increment = increment - free.T @ (free @ increment)
    return float(np.linalg.norm(increment[3:])), float(np.linalg.norm(increment[:3]))


def test_the_touch_finds_where_closing_the_hand_has_moved_the_object(run: dict[str, Any]) -> None:
    seen_gap, seen_turn = determined_error(run, run["X_PO_seen"])
    felt_gap, felt_turn = determined_error(run, run["X_PO_hat"])
    # The object has moved far enough for the prior alone to be wrong.
    assert seen_gap > 0.015
    assert seen_turn > np.radians(8)
    assert felt_gap < 0.2 * seen_gap
    assert felt_turn < 0.3 * seen_turn


def test_four_fingertips_feel_it(run: dict[str, Any]) -> None:
    contacts = estimated(run, "contacts")
    assert len(contacts) >= 4
    assert np.all(np.linalg.norm(contacts.f_PC, axis=1) > 0.5)


def test_it_prints_the_estimate_beside_the_truth(run: dict[str, Any]) -> None:
    assert [line.split(":")[0] for line in run["printed"].splitlines()] == ["seen", "felt", "true"]


def test_it_is_short() -> None:
    assert len(SCRIPT.read_text().splitlines()) < 60
