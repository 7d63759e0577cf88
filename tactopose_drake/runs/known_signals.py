"""The signals of a scenario with CAN devices that come from files: joint positions, palm pose, and prior."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from tactopose_drake.core.validation import FloatArray, told_of
from tactopose_drake.drivers.simulation.csv_tables import read_csv_table
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.files import load_prior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant, measured_joints
from tactopose_drake.hand.joint_matrices import joint_matrix, joint_offsets
from tactopose_drake.hand.named_joints import check_near_limits
from tactopose_drake.station.can_senses import CanSenses, FixedJoints, JointFile
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.signals import UNKNOWN_POSE, Signal, Value

# Rows of a file count as separated by a gap if the step exceeds this, s, and this multiple of the file's median step.
_LEAST_GAP = 0.15
_STEPS_OF_A_GAP = 10.0
_WIDEST = 100.0  # extent of a palm's motion, m: a larger one must be in millimetres
_PALM = ["time", "x", "y", "z", "qw", "qx", "qy", "qz"]


def known_signals(scenario: Scenario) -> dict[str, Signal]:
    """Reads the signals of the scenario's `senses.joints`, `palm` and `prior`, by the names of the station's ports.

    Joint positions and the palm's pose hold from row to row, and are unknown in gaps of a file.

    Raises:
        InvalidInputError: if the joint positions come through a port, a joint's name is unknown, or a position is
            impossible.
        InvalidFileError: if a file cannot be read.
    """
    senses = scenario.senses
    assert isinstance(senses, CanSenses)
    signals = {}
    if senses.prior:
        signals["prior"] = Signal.constant(load_prior(Path(senses.prior)))
    if senses.palm:
        signals["palm_pose"] = _palm(Path(senses.palm))
    if isinstance(senses.joints, FixedJoints):
        names, rows = list(senses.joints.positions), np.array([list(senses.joints.positions.values())])
        positions = _positions(scenario, "CanSenses.joints.positions", names, rows)
        signals["joint_positions"] = Signal([-np.inf], list(positions))
    elif isinstance(senses.joints, JointFile):
        path = Path(senses.joints.path)
        (first, *names), table = read_csv_table(path)
        _check_columns(path, [first, *names], ["time", *names])
        positions = _positions(scenario, f"{path}: positions", names, table[:, 1:])
        unknown = np.full(positions.shape[1], np.nan)
        signals["joint_positions"] = _unknown_in_gaps(table[:, 0], list(positions), unknown)
    elif senses.barrett_hand is None:
        raise InvalidInputError(
            "CanSenses.joints must be !FixedJoints or !JointFile for a run of the scenario by itself, not left out or "
            "!JointPort, for which joint positions come through an input port of your own diagram."
        )
    return signals


def check_spans(scenario: Scenario, signals: Mapping[str, Signal], end: float) -> None:
    """Checks that the files cover the run, up to the longest `max_age` of the devices.

    Args:
        scenario: a scenario with CAN devices.
        signals: its `known_signals`.
        end: end of the run, s; infinite if an interrupt ends it.

    Raises:
        InvalidInputError: if a file starts too late or ends too early.
    """
    senses = scenario.senses
    assert isinstance(senses, CanSenses)
    ages = [board.max_age for board in senses.fingers.values()]
    max_age = max([*ages, *([] if senses.barrett_hand is None else [senses.barrett_hand.max_age])])
    joints = senses.joints.path if isinstance(senses.joints, JointFile) else ""
    for name, path in (("joint_positions", joints), ("palm_pose", senses.palm)):
        if path and signals[name].times[0] > max_age:
            raise InvalidInputError(
                f"{path} must begin with the run, whose time 0 is its start, not at {signals[name].times[0]:.15g} s."
            )
        if path and signals[name].times[-1] + max_age < end:
            run = f"the run ends, at {end:g} s" if np.isfinite(end) else "the run ends, which has no end"
            raise InvalidInputError(
                f"{path} must go on until {run}, not end at {signals[name].times[-1]:.15g} s. Or choose a shorter "
                "duration."
            )


def _positions(scenario: Scenario, where: str, names: list[str], rows: FloatArray) -> FloatArray:
    """Positions of the whole hand, shape (n, nq), from those of k joints (n, k); others are coupled, or 0."""
    plant, hand = make_hand_plant(load_hand_config(scenario.hand))
    resting = [name for name in measured_joints(plant, hand) if name not in names]
    measured = [*names, *resting]
    values = np.column_stack([rows, np.zeros((len(rows), len(resting)))])
    with told_of(f"{where}: "):
        matrix = joint_matrix(plant, hand, measured)
    positions: FloatArray = values @ matrix.T + joint_offsets(plant, hand, measured)
    for extremes in (rows.min(axis=0), rows.max(axis=0)):
        check_near_limits(where, dict(zip(names, extremes, strict=True)), plant, hand)
    return positions


def _unknown_in_gaps(times: FloatArray, values: list[Value], unknown: Value) -> Signal:
    """The signal of values over time; `unknown` in gaps, from when the row before a gap is older than usual."""
    steps = np.diff(times)
    longest = max(_LEAST_GAP, _STEPS_OF_A_GAP * float(np.median(steps))) if len(steps) else 0.0
    known = times.tolist()
    for row in (np.flatnonzero(steps > longest) + 1)[::-1].tolist():
        known.insert(row, known[row - 1] + longest)
        values.insert(row, unknown)
    return Signal(known, values)


def _palm(path: Path) -> Signal:
    """Reads X_WP over time."""
    names, table = read_csv_table(path)
    _check_columns(path, names, _PALM)
    p, lengths = table[:, 1:4], np.linalg.norm(table[:, 4:], axis=1)
    if np.any(np.abs(lengths - 1.0) > 1e-3):
        wrong = int(np.abs(lengths - 1.0).argmax())
        raise InvalidFileError(
            f"{path}: the quaternion at {table[wrong, 0]:g} s must have the length 1, not {lengths[wrong]:g}."
        )
    if (widest := float(np.ptp(p, axis=0).max())) > _WIDEST:
        raise InvalidFileError(
            f"{path}: the positions x, y, z, must be within {_WIDEST:g} m of each other, not {widest:g} m apart. "
            "Multiply by 0.001 what is in millimetres."
        )
    turns = [Quaternion(q / length) for q, length in zip(table[:, 4:], lengths, strict=True)]
    poses = [RigidTransform(*pose) for pose in zip(turns, p, strict=True)]
    return _unknown_in_gaps(table[:, 0], poses, UNKNOWN_POSE)


def _check_columns(path: Path, names: list[str], allowed: list[str]) -> None:
    """Raises InvalidFileError if a file's columns are not the allowed ones."""
    if names != allowed:
        raise InvalidFileError(f"{path} must have the columns {', '.join(allowed)}, not {', '.join(names)}.")
