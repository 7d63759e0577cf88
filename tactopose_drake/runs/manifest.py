"""The manifest of a recording's folder: the scenario that was run, the files, and data that no log has."""

import dataclasses
import importlib.metadata
import os
import platform
import shutil
from collections.abc import Mapping
from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_dump_typed

from tactopose_drake.core.validation import FloatArray, finite_array, positive_number, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.resources import load_typed_yaml, read_yaml
from tactopose_drake.resources.yaml_files import bare
from tactopose_drake.station.can_senses import CanSenses
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.scenario_paths import resolve_paths, with_absolute_paths
from tactopose_drake.station.senses import RecordedSenses

MANIFEST, SIGNALS, ESTIMATES = "manifest.yaml", "signals.jsonl", "estimates.jsonl"
_FORMAT = 1
_LEAST_FREE = 20_000_000  # free bytes that are needed, enough for the first minute of a recording
_PACKAGES = ("tactopose_drake", "drake", "numpy", "numba", "python-can")


@dataclasses.dataclass(kw_only=True, slots=True)
class Manifest:
    """`manifest.yaml` of a recording; only data. Paths in the file are relative to its folder."""

    format: int = _FORMAT
    scenario: Scenario = dataclasses.field(default_factory=Scenario)  # with the seeds of all noise
    versions: dict[str, str] = dataclasses.field(default_factory=dict)  # of Python and the packages that were used
    start: float = 0.0  # the diagram's time 0, s since the epoch
    buses: dict[str, str] = dataclasses.field(default_factory=dict)  # log file of each bus, by the scenario's names
    # Tared gauge readings by finger, which include the fingertip's weight.
    biases: dict[str, list[float]] = dataclasses.field(default_factory=dict)

    def validate(self) -> None:
        """Raises InvalidInputError if the manifest is incomplete, or does not fit its scenario's devices."""
        if not self.versions:  # They come after the scenario; without them, the scenario may be incomplete.
            raise InvalidInputError("Manifest.versions must be there, but are missing: the file is cut off.")
        senses = self.scenario.senses
        if isinstance(senses, RecordedSenses):
            raise InvalidInputError("Manifest.scenario.senses must not be !RecordedSenses.")
        buses, fingers = (senses.buses, senses.fingers) if isinstance(senses, CanSenses) else ({}, {})
        for name, given, needed in (
            ("buses", set(self.buses), set(buses)),
            ("biases", set(self.biases), set(fingers)),
        ):
            if given != needed:
                raise InvalidInputError(
                    f"Manifest.{name} must be those of the scenario's senses, {', '.join(sorted(needed)) or 'none'}, "
                    f"not {', '.join(sorted(given)) or 'none'}."
                )
        for finger, bias in self.biases.items():
            finite_array(f"Manifest.biases[{finger}]", bias, (6,))
        positive_number("Manifest.start", self.start, allow_zero=True)

    def version_change(self) -> str:
        """A sentence that lists the versions that differ from those of the run; empty if there are none."""
        here = versions()
        changed = [
            f"{name} {then}, which here is {here.get(name, 'none')}"
            for name, then in self.versions.items()
            if here.get(name) != then
        ]
        return f"It was recorded with {'; '.join(changed)}." if changed else ""

    def check_scenario(self, scenario: Scenario, folder: Path) -> None:
        """Raises InvalidInputError if the recording cannot be replayed with a scenario.

        The estimation's parameters may differ, but not the hand, the object, and the devices. Of absolute paths only
        the file names are compared, since a project's folder may have moved.
        """
        scenario = with_absolute_paths(scenario)
        for name in ("hand", "object"):
            given, recorded = getattr(scenario, name), getattr(self.scenario, name)
            is_moved = os.path.isabs(recorded) and os.path.isabs(given) and Path(given).name == Path(recorded).name
            if given != recorded and not is_moved:
                raise InvalidInputError(
                    f"{folder} must be replayed with the {name} that it was recorded with, {recorded!r}, not {given!r}."
                )
        given, recorded = scenario.senses, self.scenario.senses
        if isinstance(given, CanSenses) and not isinstance(recorded, CanSenses):
            raise InvalidInputError(
                f"{folder} must be replayed without CAN devices, as it was recorded from the simulator."
            )
        if isinstance(given, CanSenses) and isinstance(recorded, CanSenses):
            for part in ("fingers", "barrett_hand"):
                if getattr(given, part) != getattr(recorded, part):
                    raise InvalidInputError(
                        f"{folder} must be replayed with the devices that it was recorded with, but senses.{part} "
                        "differ."
                    )


def versions() -> dict[str, str]:
    """The versions of Python and of the packages on which the estimate depends."""
    found = {"python": platform.python_version()}
    return found | {package: importlib.metadata.version(package) for package in _PACKAGES}


def save_manifest(
    folder: Path, scenario: Scenario, start: float, buses: Mapping[str, Path], biases: Mapping[str, FloatArray]
) -> None:
    """Writes `manifest.yaml`.

    Raises:
        InvalidFileError: if it cannot be written.
    """
    manifest = Manifest(
        scenario=with_absolute_paths(scenario),
        versions=versions(),
        start=start,
        buses={name: path.name for name, path in buses.items()},
        biases={finger: bias.tolist() for finger, bias in biases.items()},
    )
    try:
        (folder / MANIFEST).write_text(yaml_dump_typed(manifest))
    except OSError as error:
        raise InvalidFileError(f"{folder / MANIFEST} cannot be written ({error.strerror}).") from None


def load_manifest(folder: Path) -> Manifest:
    """Reads the manifest of a recording.

    A run writes where its data came from. Data whose manifest does not say so were recorded elsewhere, from a real
    hand.

    Raises:
        InvalidFileError: if the folder is not a recording, or has another format.
    """
    if not os.path.isfile(folder / MANIFEST):
        raise InvalidFileError(f"{folder} must be a recording, but has no {MANIFEST}.")
    _check_format(folder / MANIFEST)
    manifest = load_typed_yaml(Manifest, folder / MANIFEST)
    resolve_paths(folder, manifest.scenario)
    with told_of(f"{folder / MANIFEST}: ", InvalidFileError):
        manifest.validate()
    if not _names_senses(folder / MANIFEST):
        manifest.scenario.senses = RecordedSenses(folder=str(folder))
    for name, file in manifest.buses.items():
        if Path(file).name != file:
            raise InvalidFileError(
                f"{folder / MANIFEST}: the log of the bus {name!r} must be in its folder, not {file!r}."
            )
        if not os.path.isfile(folder / file):
            raise InvalidFileError(f"{folder / file}, the log of the bus {name!r}, is missing.")
    return manifest


def _check_format(path: Path) -> None:
    """Raises InvalidFileError if a manifest has another format, whose keys may be unknown."""
    root = read_yaml(path)
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    for key, value in pairs:
        if key.value == "format" and value.value != str(_FORMAT):
            raise InvalidFileError(f"{path} must have the format {_FORMAT}, not {bare(str(value.value))}.")


def _names_senses(path: Path) -> bool:
    """Whether a manifest's scenario has the key `senses`."""
    node = read_yaml(path)
    for name in ("scenario", "senses"):
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        node = next((value for key, value in pairs if key.value == name), None)
    return node is not None


def prepare_folder(folder: Path) -> bool:
    """Creates a folder for a new recording.

    Returns:
        Whether the folder did not exist before.

    Raises:
        InvalidInputError: if the folder is not empty or cannot be created, or its disk is full.
    """
    try:
        is_new = not folder.exists()
        if not is_new and (not folder.is_dir() or any(folder.iterdir())):
            raise InvalidInputError(f"{folder} must be new, or an empty folder, for a recording, but is neither.")
        folder.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(folder).free
        if free < _LEAST_FREE and is_new:
            folder.rmdir()
    except OSError as error:
        raise InvalidInputError(f"{folder} cannot be made ({error.strerror}).") from None
    if free < _LEAST_FREE:
        raise InvalidInputError(
            f"{folder}: its disk must have at least {_LEAST_FREE / 1e6:g} MB left for a recording, not "
            f"{free / 1e6:.1f} MB."
        )
    return is_new
