"""Tracking of the package's objects along recorded motions of real objects in a real hand.

    python examples/recorded_motions.py FOLDER --objects bust mug spray_bottle tea_box --seconds 10 --out out

FOLDER, or the environment variable TACTOPOSE_MOTIONS, is a folder of CSV files of a magnetic tracker at 100 Hz, with
columns ts (s), tx, ty, tz (m), and rx, ry, rz (rad; the rotation is Rz Ry Rx), such as those of New Dexterity's
Sensorized-Objects. They are not shipped; without them, the script only prints a message. With `--out`, it also plots
the errors over time (recorded_motions.png), without the directions that the touch leaves free.

Only the motion relative to the first row is used: the object moves by it from a random pose, and five fingertips move
with it without slip. Their contacts with the true mesh have the noise of the sensors and of the hand's calibration,
whose standard deviations the belief knows. It begins with a prior that is 33 mm and 16 degrees off. At each instant
after the first half second, the study counts whether the best pose is right, within 10 mm and 10 degrees apart from the
directions that the touch leaves free, and whether any mode is.
"""

import argparse
import csv
import os
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from motion_families import PERIOD, load, spread_points
from nearest_images import least_error
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.objectives import SurfaceContact
from tactopose_drake.core.poses import log_so3, make_poses, random_rotations, retract
from tactopose_drake.core.posterior import free_directions
from tactopose_drake.core.synthetic import RollingTouch
from tactopose_drake.core.tracking import Frame, PoseTracker

Array = NDArray[np.float64]
FOLDER_VARIABLE = "TACTOPOSE_MOTIONS"
SETTLED = 50  # frames
RIGHT, WRONG = np.array([0.010, 10.0]), np.array([0.020, 20.0])  # m, deg


def read_motion(path: Path, seconds: float) -> tuple[Array, Array]:
    """Reads rotations (n, 3, 3) and positions (n, 3), m, at 100 Hz."""
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    read = {name: np.array([float(row[name]) for row in rows]) for name in ("ts", "tx", "ty", "tz", "rx", "ry", "rz")}
    begin = read["ts"][0]
    times = begin + PERIOD * np.arange(int(min(seconds, read["ts"][-1] - begin) / PERIOD + 1e-6))
    p = np.stack([np.interp(times, read["ts"], read[name]) for name in ("tx", "ty", "tz")], axis=1)
    x, y, z = (np.interp(times, read["ts"], np.unwrap(read[name])) for name in ("rx", "ry", "rz"))
    zero, one = np.zeros_like(x), np.ones_like(x)

    def turn(angle: Array, order: tuple[int, int, int]) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        R = np.stack([np.stack([one, zero, zero], -1), np.stack([zero, c, -s], -1), np.stack([zero, s, c], -1)], -2)
        return R[:, order][:, :, order]

    return turn(z, (1, 2, 0)) @ turn(y, (2, 0, 1)) @ turn(x, (0, 1, 2)), p


def error(model: tp.ObjectModel, X_hat: Array, X_true: Array, free: Array) -> Array:
    """Error [m, deg] to the nearest symmetry image of the truth, without the part along the free directions."""
    u = least_error(model, X_hat, X_true, free)
    return np.array([np.linalg.norm(u[3:]), np.degrees(np.linalg.norm(u[:3]))])


def follow(name: str, R: Array, p: Array, seed: int) -> Array:
    """For each instant: whether the best pose is right, any is, "ok" while wrong; update time, s; error, m and deg."""
    generator, model = np.random.default_rng(seed), load(name)
    R_PO = random_rotations(generator, 1)[0]
    X_PO = make_poses(R_PO, 0.03 * generator.normal(size=3) - R_PO @ model.vertices.mean(axis=0))
    touch = RollingTouch(model, X_PO, spread_points(model, generator, 5), generator)
    guess = tp.PosePrior(X_PO)
    guess = tp.PosePrior(retract(X_PO, generator.normal(size=6) * guess.sigmas))
    tracker = PoseTracker(model)
    belief, rows = tracker.start(), []
    for i in range(1, len(R)):
        w = log_so3(R[i] @ R[i - 1].T) / PERIOD
        middle, v = touch.X_PO[:, 3], (p[i] - p[i - 1]) / PERIOD
        touch.move(np.concatenate([w, np.cross(middle, w) + v]), np.tile(w, (5, 1)), False, PERIOD)
        contacts, velocities = touch.measure()
        frame = Frame(PERIOD * i, Evidence(contacts, prior=guess), touch.sources, velocities)
        started = time.thread_time()
        belief = tracker.step(belief, frame)
        seconds = time.thread_time() - started
        information = SurfaceContact(model.grid, contacts).normal_equations(touch.X_PO[None]).hessian
        free = free_directions(information, model.size)[0]
        errors = [error(model, X, touch.X_PO, free) for X in belief.X_PO]
        right = [bool(np.all(e < RIGHT)) for e in errors]
        wrong = belief.status == "ok" and bool(np.any(errors[0] > WRONG))
        rows.append([right[0], any(right), wrong, seconds, *errors[0]])
    return np.array(rows[SETTLED:], dtype=np.float64)


def plot(followed: dict[tuple[str, str], Array], path: Path) -> None:
    """Plots the best pose's errors over time: a row for each motion, with mm and deg side by side."""
    motions = list(dict.fromkeys(motion for motion, _ in followed))
    figure = Figure(figsize=(12, 3 * len(motions)), layout="constrained")
    for line, motion in zip(figure.subplots(len(motions), 2, squeeze=False), motions, strict=True):
        for axes, column, scale, unit in zip(line, (4, 5), (1e3, 1.0), ("mm", "deg"), strict=True):
            for name in (name for of_motion, name in followed if of_motion == motion):
                rows = followed[motion, name]
                axes.plot(PERIOD * (SETTLED + np.arange(len(rows))), scale * rows[:, column], label=name, linewidth=0.8)
            axes.axhline(scale * RIGHT[0] if unit == "mm" else RIGHT[1], color="0.7", linewidth=0.8)
            axes.set(title=motion, xlabel="s", ylabel=f"error, {unit}", yscale="log")
        line[0].legend(fontsize=8)
    figure.savefig(path, format="png")


def main() -> None:
    """Prints a table: a line for each motion and object, and one for all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=os.environ.get(FOLDER_VARIABLE))
    parser.add_argument("--objects", nargs="+", default=["bust", "mug", "spray_bottle", "tea_box"])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each recording")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="draws the errors over time into this folder")
    arguments = parser.parse_args()
    paths = sorted(Path(arguments.folder).glob("*.csv")) if arguments.folder else []
    if not paths:
        print(f"No recordings: skipped. {FOLDER_VARIABLE} names a folder of them.")
        return
    table = Table("motion", "object", "instants", "best right", "any right", '"ok", wrong', "update median, 99 %")
    followed: dict[tuple[str, str], Array] = {}
    for path in paths:
        R, p = read_motion(path, arguments.seconds)
        for name in arguments.objects:
            rows = follow(name, R, p, arguments.first_seed + len(followed))
            followed[path.stem, name] = rows
            table.add_row(path.stem, name, *cells(rows))
    table.add_row("all", "", *cells(np.concatenate(list(followed.values()))), style="bold")
    Console().print(table)
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        plot(followed, arguments.out / "recorded_motions.png")


def cells(rows: Array) -> list[str]:
    """The results of some instants as cells of the table."""
    best, some, wrong = rows[:, :3].mean(axis=0)
    median, slowest = 1e3 * np.quantile(rows[:, 3], [0.5, 0.99])
    return [str(len(rows)), f"{best:.1%}", f"{some:.1%}", f"{wrong:.2%}", f"{median:.1f} ms, {slowest:.1f} ms"]


if __name__ == "__main__":
    main()
