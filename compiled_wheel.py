"""The build hook for wheels with compiled kernels; see `make wheel`.

It compiles all kernels for x86-64-v3 with the numba of the build environment, and adds them to the wheel beside the
sources, where `tactopose_drake/core/shipped_kernels.py` finds them. They are kept in `out/`, so that unchanged kernels
are not compiled again. On other platforms, it has no effect.
"""

import hashlib
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

WARM_UP = "from tactopose_drake.cli.entry import start; start()"


class CompiledKernels(BuildHookInterface):
    """Compiles the kernels, and adds them to the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before the build."""
        if version == "editable":
            return
        if sysconfig.get_platform() != "linux-x86_64":
            self.app.display_warning("Compiled kernels are for Linux on x86-64 only; this wheel is without them.")
            return
        for path in compile_kernels(Path(self.root)):
            build_data["force_include"][str(path)] = f"tactopose_drake/core/compiled/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = f"cp{sys.version_info.major}{sys.version_info.minor}-none-linux_x86_64"


def compile_kernels(root: Path) -> list[Path]:
    """The files of all kernels of a checkout, compiled for x86-64-v3."""
    sources = sorted((root / "tactopose_drake" / "core").rglob("*.py"))
    content = b"".join(
        path.read_bytes() for path in sources if path.stem.endswith("_kernels") or path.parent.name == "core"
    )
    folder = root / "out" / "kernels" / hashlib.sha256(content + sys.version.encode()).hexdigest()[:16]
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(folder),
        "NUMBA_CPU_NAME": "x86-64-v3",
        "NUMBA_CPU_FEATURES": "",
        "PYTHONPATH": str(root),
    }
    subprocess.run([sys.executable, "-c", WARM_UP, "warm-up"], env=environment, cwd=root, check=True)
    return sorted(path for path in folder.rglob("*.nb[ic]") if path.is_file())
