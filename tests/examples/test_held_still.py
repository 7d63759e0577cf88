import dataclasses
import re

import numpy as np
import pytest
from pydrake.math import RigidTransform

import tactopose_drake as tp
from tests.examples.scripts import load_script


def test_what_moves_by_next_to_nothing_gives_the_same_answers(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["held_still.py", "--trials", "30", "--objects", "cube", "bust", "mug"])
    load_script("held_still.py").main()
    rows = [line for line in capsys.readouterr().out.splitlines() if re.match(r"(3|5|8|all) ", line)]
    assert len(rows) == 7
    touches = int(re.findall(r"(\d+) touches", rows[-1])[0])
    changed = [float(share) for share in re.findall(r"([0-9.]+)%", rows[-1])]
    assert touches == 30
    by_move, by_seed = changed[:2], changed[2:]
    assert max(by_move) <= 100.0 / 30.0 + 0.1
    assert by_seed[0] >= by_seed[1]
    assert by_seed[1] <= 30.0


def test_a_change_is_told_in_sigmas_and_up_to_symmetries(blob: tp.ObjectModel) -> None:
    script = load_script("held_still.py")
    contacts = tp.Contacts(blob.samples.points[::150][:6], blob.samples.normals[::150][:6])
    estimate = tp.estimate_pose(blob, contacts)
    assert script.change(blob, estimate, estimate) == (0.0, pytest.approx(0.0, abs=1e-6))
    best, sigma = estimate.best, np.sqrt(1.0 / np.linalg.inv(estimate.best.covariance)[3, 3])
    X_PO = best.X_PO.GetAsMatrix34()
    X_PO[0, 3] += 2.0 * sigma
    best = dataclasses.replace(best, X_PO=RigidTransform(X_PO), probability=best.probability - 0.1)
    other = dataclasses.replace(estimate, hypotheses=(best, *estimate.hypotheses[1:]))
    assert script.change(blob, estimate, other) == (pytest.approx(0.1), pytest.approx(2.0, rel=1e-3))
