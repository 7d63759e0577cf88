import os
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

from tests.core.meshes import shape_poor_in_symmetry

SCRIPT = Path(__file__).parents[2] / "examples" / "identify_on_a_cluster.py"


def test_two_workers_say_what_one_process_says(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason='Dask is not installed: pip install "tactopose_drake[cluster]"')
    (tmp_path / "library").mkdir()
    trimesh.creation.box((0.1, 0.06, 0.04)).export(tmp_path / "library" / "box.stl")
    shape_poor_in_symmetry().export(tmp_path / "library" / "block.stl")
    result = subprocess.run(
        [sys.executable, SCRIPT, "--library", tmp_path / "library", "--touched", "block"],
        capture_output=True,
        text=True,
        env=os.environ | {"TACTOPOSE_CACHE_DIR": str(tmp_path / "cache")},
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("1. block: ")
    assert "This process says the same." in result.stdout
