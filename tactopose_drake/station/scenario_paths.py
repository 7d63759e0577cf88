"""Resolution of a scenario's paths, which are relative to the folder of its file; names stay names."""

import copy
import os
from pathlib import Path
from typing import Any, TypeVar

from tactopose_drake.station.can_senses import CanSenses, JointFile
from tactopose_drake.station.message_channels import Ros2Publishing, Ros2Senses
from tactopose_drake.station.senses import RecordedSenses

_Scenario = TypeVar("_Scenario")


def resolve_paths(folder: Path, scenario: Any) -> None:
    """Makes the relative paths of a `Scenario` absolute, starting from a folder.

    A hand, object or sensor, which may also be one of the package's names, is a path if it has a suffix or a slash.
    """
    for part, key in ((scenario, "hand"), (scenario, "object"), (scenario.sensor, "file")):
        setattr(part, key, _named(folder, getattr(part, key)))
    if scenario.grip is not None:
        scenario.grip.X_PO = {_named(folder, name): X_PO for name, X_PO in scenario.grip.X_PO.items()}
    senses = scenario.senses
    if isinstance(senses, RecordedSenses):
        senses.folder = _path(folder, senses.folder)
    if isinstance(senses, CanSenses):
        senses.prior, senses.palm = _path(folder, senses.prior), _path(folder, senses.palm)
        if isinstance(senses.joints, JointFile):
            senses.joints.path = _path(folder, senses.joints.path)
        if senses.simulated is not None:
            senses.simulated.folder = _path(folder, senses.simulated.folder)
    for link in (senses, scenario.publish):
        if isinstance(link, Ros2Senses | Ros2Publishing):
            link.config = _path(folder, link.config)


def with_absolute_paths(scenario: _Scenario) -> _Scenario:
    """A copy of a `Scenario` whose relative paths, which are from the current folder, are absolute."""
    resolved = copy.deepcopy(scenario)
    resolve_paths(Path.cwd(), resolved)
    return resolved


def _named(folder: Path, name_or_path: str) -> str:
    is_path = bool(Path(name_or_path).suffix) or "/" in name_or_path
    return _path(folder, name_or_path) if is_path else name_or_path


def _path(folder: Path, path: str) -> str:
    """The absolute path; an empty one stays empty."""
    return os.path.abspath(folder / path) if path else path
