from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

from tests.examples.scripts import share_script


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return share_script("many_touches.py")


def test_each_touch_has_the_pose_of_its_object(example: ModuleType, tmp_path: Path) -> None:
    arguments = ["--touches", "30", "--seed", "3", "--jobs", "2", "--out", str(tmp_path / "new")]
    result = CliRunner().invoke(example.main, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "30 touches of 12 objects by 2 threads in" in result.stdout
    with np.load(tmp_path / "new" / "touches.npz") as file:
        found = dict(file)
    assert len(found["name"]) == 12
    assert list(found["touched"][:13]) == [*range(12), 0]
    sure = found["probability"] > 0.95
    off = np.linalg.norm(found["X_PO"][sure, :, 3] - found["X_PO_true"][sure, :, 3], axis=1)
    assert sure.sum() >= 5
    assert np.median(off) < 0.02


@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_workers_are_of_either_kind(example: ModuleType, kind: str) -> None:
    with example.workers(kind, 1) as executor:
        assert executor.submit(len, "four").result() == 4
