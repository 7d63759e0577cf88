"""A wheel that brings its compiled kernels: nothing is compiled where it is installed, or that is told.

Building it compiles all kernels for x86-64-v3, once for each state of the checkout.
"""

import importlib.util
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tactopose_drake.core import shipped_kernels

CHECKOUT = Path(__file__).parents[1]

pytestmark = [
    pytest.mark.skipif(sysconfig.get_platform() != "linux-x86_64", reason="kernels come for Linux on x86-64"),
    pytest.mark.skipif(
        not all(importlib.util.find_spec(name) for name in ("pip", "hatchling")), reason="pip or hatchling is missing"
    ),
]

ESTIMATE = """
from numba.core import event

class Count(event.Listener):
    compiled = []
    def on_start(self, event):
        self.compiled.append(str(event.data["dispatcher"]))
    def on_end(self, event):
        pass

event.register("numba:compile", Count())
import numpy as np
import tactopose_drake as tp
from tactopose_drake.core.tracking import PoseTracker
from tactopose_drake.resources import model_path

model = tp.ObjectModel.from_mesh(model_path("objects", "mug.obj"))
points = np.array([[0.031, 0.002, 0.094], [0.008, 0.061, 0.090], [0.052, 0.030, 0.101]])
estimate = tp.estimate_pose(model, tp.Contacts(points, np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])))
tp.solve_contact(np.array([0.0, 0.0, 0.0, 0.1, 0.0, -2.0]), tp.Sphere(radius=0.01))
PoseTracker(model)
print(tp.__file__)
print(len(estimate.hypotheses) > 0, Count.compiled)
"""
RETRACT = """
import numpy as np
from tactopose_drake.core.kernels.pose_kernels import retract
out = np.empty((1, 3, 4))
retract(np.eye(3, 4)[None], np.zeros((1, 6)), out)
print(np.array_equal(out[0], np.eye(3, 4)), sum(retract.stats.cache_hits.values()))
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the wheel is installed, alone."""
    wheels, site = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input"]
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(wheels), "."]
    environment = os.environ | {"HATCH_BUILD_HOOK_ENABLE_CUSTOM": "true"}
    subprocess.run(build, cwd=CHECKOUT, env=environment, check=True, capture_output=True)
    (wheel,) = wheels.glob("*.whl")
    assert wheel.name.endswith(f"-cp{sys.version_info.major}{sys.version_info.minor}-none-linux_x86_64.whl")
    install = [*pip, "install", "--no-deps", "--no-index", "--target", str(site), str(wheel)]
    subprocess.run(install, check=True, capture_output=True)
    return site


def run(code: str, site: Path, caches: Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """In a process that knows the installed package alone, with empty caches."""
    told = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_ENABLE_AVX")
    environment = {name: value for name, value in os.environ.items() if name not in told} | settings
    environment |= {"NUMBA_CACHE_DIR": str(caches / "kernels"), "TACTOPOSE_CACHE_DIR": str(caches / "models")}
    environment["PYTHONPATH"] = str(site)
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=caches, env=environment, capture_output=True, text=True, check=True)


@pytest.mark.skipif(
    not shipped_kernels.is_level_3(), reason="this processor is not of level x86-64-v3, for which kernels are compiled"
)
def test_what_is_called_first_compiles_nothing(site: Path, tmp_path: Path) -> None:
    done = run(ESTIMATE, site, tmp_path)
    package, answer = done.stdout.splitlines()
    assert Path(package).is_relative_to(site)
    assert answer == "True []"
    assert not list((tmp_path / "kernels").rglob("*.nbc"))
    assert not done.stderr


def test_elsewhere_kernels_are_compiled_and_that_is_told(site: Path, tmp_path: Path) -> None:
    done = run(RETRACT, site, tmp_path, NUMBA_CPU_NAME="generic")
    assert done.stdout.split() == ["True", "0"]
    assert "kernels are compiled here instead" in done.stderr
    again = run(RETRACT, site, tmp_path, NUMBA_CPU_NAME="generic")
    assert again.stdout.split() == ["True", "1"]
    assert not again.stderr
