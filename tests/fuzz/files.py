"""Damaged files: YAML of every schema, and the folders of recordings.

Each is read, or refused with one `TactoposeError` whose message is one line. Nothing else may happen: a write outside
the call's own folder and a program that is started are findings.
"""

import functools
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np

from tactopose_drake.core.evidence.prior import PosePrior
from tactopose_drake.drivers.can_recorder import CanRecorder
from tactopose_drake.drivers.log_frames import log_frames
from tactopose_drake.errors import EndOfLogError, TactoposeError
from tactopose_drake.estimation.files import load_contacts, load_prior
from tactopose_drake.estimation.library_files import read_library
from tactopose_drake.hand.hand_config import load_hand_config, make_hand_plant
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import model_path, resource_root
from tactopose_drake.runs.manifest import MANIFEST, SIGNALS, load_manifest, save_manifest
from tactopose_drake.runs.scenario_replay import replay
from tactopose_drake.station.arms.arm import load_arm_config
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.senses import CanBus, CanSenses, ForceTorqueBoard
from tactopose_drake.systems.force_torque_sensor import load_force_torque_model
from tactopose_drake.systems.signals import SignalRecorder, read_signals

_LONGEST_MESSAGE = 4000
_REPLAYED = 0.02  # share of the recordings that are played; the others are read

CONTACTS = """contacts:
- {position: [0.031, 0.002, 0.094], normal: [0.0, -1.0, 0.0], force: [0.0, -2.1, 0.3]}
- {position: [0.031, 0.052, 0.094], normal: [0.0, 1.0, 0.0], force: [0.0, 2.1, 0.3]}
sigma_position: 0.0005
sigma_normal_deg: 3.0
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

ODD = (
    *(".nan", "-.inf", "1e400", "-1e400", "1e-400", "9" * 400, "-" + "9" * 5000, "0x" + "f" * 300, "0o17", "0b1"),
    *("2020-13-45", "2020-01-01T25:61:61Z", "12:30:45.5", "yes", "no", "true", "~", "null", "", "''", "=", "<<", "!"),
    *("[[[[1]]]]", "{a: {b: {c: 1}}}", "[]", "{}", "[1, [2, 3]]", "*a", "&a [*a]", "&a [1]", "*b0", "<<: *a", "? x"),
    *("!!int abc", "!!float x", "!!binary aGk=", "!!set {a}", "!!omap [a: 1]", "!!timestamp x", "!Nonsense {}"),
    *("!!python/object/apply:os.system [touch pwned]", "!!python/name:os.system", "!<tag:yaml.org,2002:int> 1"),
    *("\u00fc\u4e16\u754c", "\u202eevil", '"\\x1b[31m"', '"a\\0b"', "a\x07b", "\ud7ff", "|\n  two\n  lines", ">-\n  x"),
    *("[/x]", "{{x}}", "%s%n", "../../../etc/passwd", "/dev/zero", "h" * 300, "x" * 5000, "- " * 60, "[" * 3000),
    *("0", "-0.0", "-1", "1", "2", "1.5", "1e-300", "1e300", "1000000000", "100000000000000000000", "4294967296"),
)


@functools.cache
def _schemas() -> tuple[tuple[str, str, Callable[[Path], object]], ...]:
    """Of each file: its name, its text, and what reads it."""
    models = model_path()
    scenarios = [path.read_text() for path in sorted((resource_root() / "diagrams").glob("*.scenario.yaml"))]
    found: list[tuple[str, str, Callable[[Path], object]]] = [
        ("contacts.yaml", CONTACTS, load_contacts),
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
    return load_force_torque_model(path=path)


def yaml_files(rng: np.random.Generator) -> None:
    """Reads a damaged YAML file, of contacts, a prior, a hand, a scenario, a pad, a sensor, an arm or a library."""
    schemas = _schemas()
    name, text, load = schemas[rng.integers(len(schemas))]
    with _own_folder() as folder:
        (folder / name).write_bytes(damage(text, rng))
        _read(lambda: load(folder / name))


def recordings(rng: np.random.Generator) -> None:
    """Reads, and sometimes plays, a recording of which one or two files are damaged."""
    base = _recordings()[rng.integers(2)]
    names = sorted(base)
    with _own_folder() as folder:
        chosen = {names[i] for i in rng.integers(len(names), size=rng.integers(1, 3))}
        for name, content in base.items():
            if name in chosen:
                content = _damage_bytes(content, rng) if name.endswith(".blf") else damage(content.decode(), rng)
            if name not in chosen or rng.random() > 0.05:
                (folder / name).write_bytes(content)
        if rng.random() < _REPLAYED:
            scenario = Scenario(hand="barrett_like", object="mug") if "left.blf" not in base else _can_scenario()
            _read(lambda: replay(folder, scenario, duration=0.2))
            return
        _read(lambda: (load_manifest(folder), read_signals(folder / SIGNALS)))
        for name in names:
            if name.endswith((".blf", ".asc")):
                _read(lambda path=folder / name: _read_log(path))  # type: ignore[misc]


def _read_log(path: Path) -> None:
    try:
        for count, _ in enumerate(log_frames(path)):
            assert count < 10_000, "a log of a hundred frames does not end"
    except EndOfLogError:
        return
    raise AssertionError("a log ended without saying so")


def damage(text: str, rng: np.random.Generator) -> bytes:
    """A text with a damage or a few."""
    for _ in range(rng.geometric(0.6)):
        text = _DAMAGES[rng.integers(len(_DAMAGES))](text, rng)
    content = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.1:
        content = _damage_bytes(content, rng)
    if rng.random() < 0.03:
        encoding = ("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7", "cp037")[rng.integers(6)]
        content = text.encode(encoding, "replace")
    return content


def _damage_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes of which some are others, are missing, are there twice, or are in another order."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        if not data:
            break
        start, end = sorted(rng.integers(len(data) + 1, size=2).tolist())
        match rng.integers(6):
            case 0:
                for i in rng.integers(len(data), size=rng.integers(1, 9)):
                    data[i] ^= 1 << int(rng.integers(8))
            case 1:
                del data[end:]
            case 2:
                del data[start : start + int(rng.integers(1, 40))]
            case 3:
                data[start:start] = data[start : min(end, start + 2000)]
            case 4:
                width = min(8, len(data) - start)
                filler = (b"\x00", b"\xff", b"\x7f", b"\x80")[rng.integers(4)]
                data[start : start + width] = filler * width
            case _:
                data[start:start] = rng.bytes(int(rng.integers(1, 30)))
    return bytes(data)


def _swap_lines(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    first, second = rng.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    return "\n".join(lines)


def _repeat_line(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    line = lines[rng.integers(len(lines))]
    lines[(at := rng.integers(len(lines))) : at] = [line] * int(rng.choice([1, 2, 50]))
    return "\n".join(lines)


def _drop_line(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    del lines[rng.integers(len(lines))]
    return "\n".join(lines)


def _truncate(text: str, rng: np.random.Generator) -> str:
    return text[: rng.integers(len(text) + 1)]


def _replace_value(text: str, rng: np.random.Generator) -> str:
    """One word, number or name, wherever it stands, becomes an odd one."""
    starts = [i for i in range(len(text)) if _is_word(text[i]) and (i == 0 or not _is_word(text[i - 1]))]
    if not starts:
        return text
    start = end = starts[rng.integers(len(starts))]
    while end < len(text) and _is_word(text[end]):
        end += 1
    return text[:start] + _odd(rng) + text[end:]


def _replace_number(text: str, rng: np.random.Generator) -> str:
    """One number becomes another, or that of another place."""
    found = list(re.finditer(r"(?<![\w.])-?[0-9][0-9.e+-]*(?!\w)", text))
    if not found:
        return text
    old, other = (found[i] for i in rng.integers(len(found), size=2))
    new = rng.choice([other.group(), f"-{old.group()}", f"{old.group()}0000", *ODD[-11:]])
    return text[: old.start()] + new + text[old.end() :]


def _replace_rest_of_line(text: str, rng: np.random.Generator) -> str:
    colons = [i for i, letter in enumerate(text) if letter == ":"]
    if not colons:
        return text
    start = colons[rng.integers(len(colons))] + 1
    end = text.find("\n", start)
    return f"{text[:start]} {_odd(rng)}{text[end if end >= 0 else len(text) :]}"


def _insert(text: str, rng: np.random.Generator) -> str:
    at = rng.integers(len(text) + 1)
    return text[:at] + _odd(rng) + text[at:]


def _insert_letter(text: str, rng: np.random.Generator) -> str:
    at = rng.integers(len(text) + 1)
    letters = "{}[]:,-?!&*#|>'\"%@`~= \t\n\r\x00\x85\u2028\ufeff"
    return text[:at] + letters[rng.integers(len(letters))] + text[at:]


def _laugh(text: str, rng: np.random.Generator) -> str:
    """References to references, in front."""
    count, width = int(rng.integers(2, 12)), int(rng.integers(2, 12))
    lines = ["_b0: &b0 [0, 1]"] + [f"_b{i}: &b{i} [{', '.join([f'*b{i - 1}'] * width)}]" for i in range(1, count)]
    return "\n".join(lines) + "\n" + text


_DAMAGES = (
    *(_swap_lines, _repeat_line, _drop_line, _truncate, _insert, _insert_letter, _laugh),
    *(_replace_value, _replace_value, _replace_number, _replace_number, _replace_rest_of_line, _replace_rest_of_line),
)


def _is_word(letter: str) -> bool:
    return letter.isalnum() or letter in "._-+"


def _odd(rng: np.random.Generator) -> str:
    return ODD[rng.integers(len(ODD))]


def _read(read: Callable[[], object]) -> None:
    """Reads, and looks at the refusal if there is one."""
    try:
        read()
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
def _own_folder() -> Iterator[Path]:
    """A folder for one call, outside of which nothing may be written; no program may be started meanwhile."""
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
    if isinstance(path, str | bytes | os.PathLike) and not os.path.realpath(os.fsdecode(path)).startswith(_folder):
        _strays.append(f"{event} {os.fsdecode(path)}")


def _can_scenario() -> Scenario:
    board = functools.partial(ForceTorqueBoard, bus="left")
    senses = CanSenses(
        buses={"left": CanBus(interface="virtual"), "right": CanBus(interface="virtual")},
        fingers={"first": board(base=0x20), "middle": board(base=0x21), "thumb": ForceTorqueBoard(bus="right")},
    )
    return Scenario(object="cube", senses=senses)


@functools.cache
def _recordings() -> tuple[dict[str, bytes], dict[str, bytes]]:
    """The files of two recordings: of the simulated hand with pads, and of force-torque boards on two buses."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        pads = Path(name, "pads")
        pads.mkdir()
        simulated = Scenario(hand="barrett_like", object="mug")
        save_manifest(pads, simulated, 0.0, {}, {})
        config = load_hand_config("barrett_like")
        with SignalRecorder(pads / SIGNALS) as recorder:
            for time in (0.0, 0.05, 0.1, 0.15):
                _record_common(recorder, "barrett_like", time, rng)
                for pad in config.pads:
                    pressures = rng.uniform(0.0, 1e4, size=len(load_tactile_pad(pad.array).layout))
                    recorder.write(f"pressures_{pad.name}", time, pressures)
        boards = Path(name, "boards")
        boards.mkdir()
        scenario = _can_scenario()
        assert isinstance(scenario.senses, CanSenses)
        logs = {"left": boards / "left.blf", "right": boards / "right.blf"}
        save_manifest(boards, scenario, 1.7e9, logs, {finger: np.zeros(6) for finger in scenario.senses.fingers})
        with SignalRecorder(boards / SIGNALS) as recorder:
            _record_common(recorder, scenario.hand, 0.0, rng)
        for log in (*logs.values(), boards / "same.asc"):
            with CanRecorder(log) as writer:
                for i in range(100):
                    data = rng.bytes(int(rng.integers(9)))
                    frame = can.Message(
                        arbitration_id=0x200 + int(rng.integers(64)), is_extended_id=False, data=data,
                        timestamp=1.7e9 + 0.004 * i, is_rx=bool(rng.integers(2)),
                    )  # fmt: skip
                    writer.write(frame, 0)
        return _contents(pads), _contents(boards)


def _record_common(recorder: SignalRecorder, hand: str, time: float, rng: np.random.Generator) -> None:
    plant, _ = make_hand_plant(load_hand_config(hand))
    recorder.write("joint_positions", time, rng.uniform(0.0, 1.0, size=plant.num_positions()))
    recorder.write("prior", time, PosePrior(np.eye(3, 4)))


def _contents(folder: Path) -> dict[str, bytes]:
    assert (folder / MANIFEST).is_file()
    return {path.name: path.read_bytes() for path in folder.iterdir()}
