import contextlib
import io
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

EXAMPLES = Path(__file__).parents[2] / "examples"
# Of the bust at the end of own_diagram.py.
X_PO = RigidTransform(RollPitchYaw(1.4824, 0.0171, 1.2713), [-0.0588, -0.0240, 0.0582])


@pytest.fixture(scope="module")
def run() -> dict[str, Any]:
    """What the script's names stand for at its end, and what it has printed."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        names = runpy.run_path(str(EXAMPLES / "estimate_from_contacts.py"))
    return {**names, "printed": printed.getvalue()}


def error(X: RigidTransform) -> tuple[float, float]:
    """Distance and angle from the true pose, m and rad."""
    turn = X_PO.rotation().InvertAndCompose(X.rotation()).ToAngleAxis().angle()
    return float(np.linalg.norm(X.translation() - X_PO.translation())), float(turn)


def test_the_touch_corrects_the_guess(run: dict[str, Any]) -> None:
    gap, turn = error(run["estimate"].best.X_PO)
    gap_guess, turn_guess = error(run["X_PO_camera"])
    assert (round(1e3 * gap_guess), round(np.degrees(turn_guess))) == (28, 18)
    assert gap < 0.004
    assert turn < np.radians(4)


def test_it_prints_status_and_pose(run: dict[str, Any]) -> None:
    # Four touches: the best of a few poses that explain them carries most of the mass.
    assert run["estimate"].best.probability > 0.7
    assert run["printed"].startswith(f"{run['estimate'].status} RigidTransform(")


def test_its_core_is_five_lines() -> None:
    source = (EXAMPLES / "estimate_from_contacts.py").read_text()
    assert len(source[source.index("model = ") :].splitlines()) == 5
