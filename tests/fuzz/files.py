"""Damaged YAML files of every schema.

Each is read, or refused with one `TactoposeError` whose message is one line. Nothing else may happen: a write outside
the call's own folder and a program that is started are findings.
"""

import functools
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tactopose_drake.core.shape import model_cache
from tactopose_drake.errors import TactoposeError
from tactopose_drake.estimation.files import load_contacts, load_prior
from tactopose_drake.estimation.library_files import read_library
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.hand.touch_file import load_touch
from tactopose_drake.hand.volume_file import load_hand_volume
from tactopose_drake.resources import model_path, resource_root
from tactopose_drake.station.arms.arm import load_arm_config
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.systems.force_torque_sensor import load_force_torque_model
from tests.fuzz.file_damage import damage

_LONGEST_MESSAGE = 4000

CONTACTS = """contacts:
- {position: [0.031, 0.002, 0.094], normal: [0.0, -1.0, 0.0], force: [0.0, -2.1, 0.3]}
- {position: [0.031, 0.052, 0.094], normal: [0.0, 1.0, 0.0], force: [0.0, 2.1, 0.3]}
sigma_position: 0.0005
sigma_normal_deg: 3.0
"""
TOUCH = """contacts:
- {position: [0.031, 0.002, 0.094]}
patches:
- array: bh280_finger
  X_PT: {translation: [0.02, 0.01, 0.08], quaternion_wxyz: [1.0, 0.0, 0.0, 0.0]}
  pressures: [0, 0, 0, 0, 9e3, 0, 0, 12e3, 8e3, 0, 4e3, null, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
  alpha: 2.0e-8
- points: [[0, 0, 0], [0.004, 0, 0], [0, 0.004, 0]]
  normals: [[0, 0, 1], [0, 0, 1], [0, 0, 1]]
  pressures: [0, 5e3, 7e3]
  alpha: 2.0e-8
  threshold: 100
  saturation: 250e3
planes:
- {point: [0.0, 0.0, 0.02], normal: [0.0, 0.0, 1.0], sigma: 0.002}
"""
SPHERES = """spheres: [{center: [0.0, -0.03, 0.02], radius: 0.015}, {center: [0.02, -0.03, 0.05], radius: 0.009}]
untouched: [{center: [0.05, 0.0, 0.11], radius: 0.008}]
sigma: 0.001
"""
VOLUME = """hand: shadow_like
joints: {FFJ4: 0.0, FFJ3: 0.5, FFJ2: 0.1}
untouched: [first]
"""
PRIOR = """X_PO: {translation: [0.1, 0.2, 0.3], quaternion_wxyz: [0.0, 1.0, 0.0, 0.0]}
sigma_translation: 0.02
sigma_rotation_deg: 10.0
"""
LIBRARY = """mug: {mesh: mug.obj, mass: 0.32}
nut: {mesh: hardware/nut.stl, symmetry: [{axis: [0, 0, 1], point: [0, 0, 0], order: 6}]}
bowl: {mesh: bowl.obj, symmetry: auto}
"""
PLACE = """grip:
  X_PO:
    cube: {translation: !UniformVector {min: [0, 0, 0.1], max: [0.01, 0, 0.1]}, rotation: !Rpy {deg: [0, 90, 0]}}
X_WBase: {rotation: !AngleAxis {angle_deg: 90, axis: [0, 0, 1]}, translation: [0.1, 0, 0]}
plant: {time_step: 0.004, contact_model: hydroelastic, discrete_contact_approximation: lagged}
estimation: {estimator: {method: pair_search, max_duration: 0.5}, contacts: {sigma_position: 0.001}}
tracking: {belief: {tracker: {}}}
object: cube
seed: 3
"""


@functools.cache
def _schemas() -> tuple[tuple[str, str, Callable[[Path], object]], ...]:
    """Of each file: its name, its text, and what reads it."""
    models = model_path()
    scenarios = [path.read_text() for path in sorted((resource_root() / "diagrams").glob("*.scenario.yaml"))]
    found: list[tuple[str, str, Callable[[Path], object]]] = [
        ("contacts.yaml", CONTACTS, load_contacts),
        ("touch.yaml", TOUCH, load_touch),
        ("spheres.yaml", SPHERES, load_hand_volume),
        ("volume.yaml", VOLUME, load_hand_volume),
        ("prior.yaml", PRIOR, load_prior),
        ("library.yaml", LIBRARY, read_library),
        ("nano17.yaml", (models / "sensors/nano17.yaml").read_text(), _load_sensor),
        *(("own.scenario.yaml", text, load_scenario) for text in (*scenarios, PLACE)),
    ]
    found += [("own.hand.yaml", path.read_text(), load_hand_config) for path in sorted(models.glob("hands/*/*.yaml"))]
    found += [("own.arm.yaml", path.read_text(), load_arm_config) for path in sorted(models.glob("arms/*/*.yaml"))]
    pads = [path for path in sorted(models.glob("sensors/*.yaml")) if path.name != "nano17.yaml"]
    return *found, *(("own.pad.yaml", path.read_text(), load_tactile_pad) for path in pads)


def _load_sensor(path: Path) -> object:
    return load_force_torque_model(name_or_path=path)


def yaml_files(rng: np.random.Generator) -> None:
    """Reads a damaged YAML file, of contacts, a prior, a hand, a scenario, a pad, a sensor, an arm or a library."""
    schemas = _schemas()
    name, text, load = schemas[rng.integers(len(schemas))]
    with own_folder() as folder:
        (folder / name).write_bytes(damage(text, rng))
        read(lambda: load(folder / name))


def read(reading: Callable[[], object]) -> None:
    """Reads, and looks at the refusal if there is one."""
    try:
        reading()
    except TactoposeError as error:
        message = str(error)
        assert message, "a refusal says nothing"
        assert len(message) <= _LONGEST_MESSAGE, f"a refusal has {len(message)} letters"
        assert message.count("\n") == 0, f"a refusal has more than a line: {message!r}"


_folder = ""  # of the present call; what is written elsewhere is a finding
_strays: list[str] = []
_CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.truncate", "os.link", "os.symlink")
_TO_WRITE = os.O_WRONLY | os.O_RDWR | os.O_CREAT


@contextmanager
def own_folder() -> Iterator[Path]:
    """A folder for one call; elsewhere nothing may be written but the package's cache, and no program be started."""
    global _folder
    _install_watch()
    with tempfile.TemporaryDirectory() as name:
        _strays.clear()
        _folder = os.path.realpath(name)
        try:
            yield Path(name)
        finally:
            _folder = ""
    assert not _strays, f"a file made the reader do this: {_strays}"


@functools.cache
def _install_watch() -> None:
    sys.addaudithook(_watch)


def _watch(event: str, arguments: tuple[object, ...]) -> None:
    if not _folder:
        return
    if event in ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "ctypes.dlopen"):
        _strays.append(f"{event} {arguments}")
    elif event in _CHANGES or (event == "open" and isinstance(arguments[2], int) and arguments[2] & _TO_WRITE):
        _note(event, arguments[0])


def _note(event: str, path: object) -> None:
    allowed = (_folder, os.path.realpath(model_cache.cache_folder()))
    if isinstance(path, str | bytes | os.PathLike) and not os.path.realpath(os.fsdecode(path)).startswith(allowed):
        _strays.append(f"{event} {os.fsdecode(path)}")
