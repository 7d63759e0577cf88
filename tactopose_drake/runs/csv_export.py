"""Export of a recording as one CSV table."""

import csv
import heapq
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from tactopose_drake.core.times import has_exceeded
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant, sliding_joints
from tactopose_drake.runs.recorded_senses import RecordedRun
from tactopose_drake.systems.signals import Signal, Value

_POSE = ("p_x_m", "p_y_m", "p_z_m", "q_w", "q_x", "q_y", "q_z")
_WRENCH = ("m_x_Nm", "m_y_Nm", "m_z_Nm", "f_x_N", "f_y_N", "f_z_N")
_OBJECT = (*_POSE, *(f"sigma_w_{axis}_rad" for axis in "xyz"), *(f"sigma_v_{axis}_m" for axis in "xyz"), "probability")
# Hypotheses whose best one gets columns, and the prefix of these.
_BEST = {
    "hypotheses": "object",
    "tracked_hypotheses": "tracked",
}

# The time of a change, the group of columns, and its numbers or texts; none if the value is unknown.
_Cells = tuple[float, str, Sequence[str]]


def write_csv(run: RecordedRun, path: Path) -> None:
    """Writes a row for each time at which anything changed.

    Changes of different things within 1 us are in one row, with the time of the first. A cell is empty if its column
    has no new value at that time, and "nan" if there was no reading, or a pose is no longer known. Columns are named
    `<what>/<part>_<unit>`: `time_s`, `joint/<joint>_rad`, `wrench/<finger>/f_x_N`, `pressure/<pad>/<cell>_Pa`,
    `prior/p_x_m`, `true/p_x_m`, `object/p_x_m` of the best hypothesis, `status`, `sense_status`, and with tracking
    `tracked/p_x_m` and `tracked_status`.

    Args:
        run: the recording.
        path: path of the file, which is replaced.

    Raises:
        InvalidFileError: if the file cannot be written.
    """
    columns: dict[str, tuple[str, ...]] = {}
    for name, signal in run.signals.items():
        columns[name] = _columns(name, run, signal.values)
    for name, what in _BEST.items():
        if any(name in line for line in run.estimates):
            columns[name] = tuple(f"{what}/{part}" for part in _OBJECT)
    columns |= {text: (text,) for text in _texts(run)}
    header = [column for group in columns.values() for column in group]
    start = dict(zip(columns, np.cumsum([0, *map(len, columns.values())]).tolist(), strict=False))
    with written_beside(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["time_s", *header])
        row, row_time, known = [""] * len(header), None, set[str]()
        filled = dict[str, float]()  # the time of each group of columns that has cells in this row
        for time, name, cells in _changes(run):
            if row_time is None:
                row_time = time
            elif has_exceeded(time, row_time, 0.0) or time > filled.get(name, time):
                table.writerow([repr(row_time), *row])
                row, row_time, filled = [""] * len(header), time, {}
            filled[name] = time
            # A value that becomes unknown must not look like one that stays as it was.
            known |= {name} if cells else set()
            values = cells or ["nan" if name in known else ""] * len(columns[name])
            row[start[name] : start[name] + len(values)] = values
        if row_time is not None:
            table.writerow([repr(row_time), *row])


def _texts(run: RecordedRun) -> list[str]:
    """The statuses that have columns."""
    further = ("sense_status", "tracked_status")
    return ["status", *(text for text in further if any(text in line for line in run.estimates))]


def _columns(name: str, run: RecordedRun, values: Sequence[Value]) -> tuple[str, ...]:
    """The columns of a signal."""
    if name == "joint_positions":
        units = _joint_units(run)
        return tuple(f"joint/{joint}_{units[joint]}" for joint in run.joints)
    if name.startswith("wrench_"):
        return tuple(f"wrench/{name.removeprefix('wrench_')}/{part}" for part in _WRENCH)
    if name.startswith("pressures_"):
        count = len(next(iter(values), ()))
        return tuple(f"pressure/{name.removeprefix('pressures_')}/{cell}_Pa" for cell in range(count))
    return tuple(f"{'true' if name == 'true_pose' else name}/{part}" for part in _POSE)


def _joint_units(run: RecordedRun) -> dict[str, str]:
    plant, hand = make_hand_plant(load_hand_config(run.manifest.scenario.hand))
    return dict.fromkeys(run.joints, "rad") | dict.fromkeys(sliding_joints(plant, hand), "m")


def _changes(run: RecordedRun) -> Iterator[_Cells]:
    """All changes in order of time, one by one: those of an hour would not fit in memory."""
    parts = [_of_signal(name, signal) for name, signal in run.signals.items()]
    return heapq.merge(*parts, _of_estimates(run), key=lambda change: change[0])


def _of_signal(name: str, signal: Signal) -> Iterator[_Cells]:
    for time, value in zip(signal.times, signal.values, strict=True):
        yield time, name, _cells(value)


def _of_estimates(run: RecordedRun) -> Iterator[_Cells]:
    texts = _texts(run)
    for line in run.estimates:
        time = float(line["time"])
        for text in texts:
            yield time, text, [str(line.get(text, ""))]
        for name in _BEST:
            hypotheses = line.get(name)
            if name in line and not hypotheses:
                yield time, name, []
            for best in (hypotheses or ())[:1]:
                sigmas = np.sqrt(np.diag(np.array(best["covariance"])))
                numbers = [*best["translation"], *best["quaternion_wxyz"], *sigmas.tolist(), best["probability"]]
                yield time, name, [repr(number) for number in numbers]


def _cells(value: Value) -> list[str]:
    if value is None:
        return []
    if isinstance(value, PosePrior | RigidTransform):
        X = value.X_PO if isinstance(value, PosePrior) else value
        value = np.append(X.translation(), X.rotation().ToQuaternion().wxyz())
    return [repr(number) for number in value.tolist()]
