import contextlib
import io
import runpy
from pathlib import Path

import numpy as np

from tactopose_drake.core.poses import increments_between

SCRIPT = Path(__file__).parents[2] / "examples" / "gel_pads.py"


def test_two_gel_pads_correct_the_cameras_pose() -> None:
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        names = runpy.run_path(str(SCRIPT))
    free = names["estimate"].best.free_directions
    off = [increments_between(names[name], names["X_PO"]) for name in ("X_PO_seen", "X_PO_hat")]
    seen, felt = ((np.linalg.norm(e[3:]), np.linalg.norm(e[:3])) for e in (e - free.T @ (free @ e) for e in off))
    assert felt[0] < 0.3 * seen[0]
    assert felt[1] < 0.4 * seen[1]
    assert all(patch.is_felt for patch in names["patches"])
    assert [line.split(":")[0] for line in printed.getvalue().splitlines()[:2]] == ["seen", "felt"]
