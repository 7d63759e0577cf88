"""Hand over and place: the hand receives a pencil, feels it, and inserts it into a hole of 15 mm radius in a box.

python examples/hand_over_and_place.py --seeds 100 --out out/hand_over
python examples/hand_over_and_place.py --seeds 100 --out out/hand_over --resume
python examples/hand_over_and_place.py --first-seed 0 --scene --out out/hand_over

After section 4.3.2.3 of [B16]. The pencil is handed over with random errors: rotated by up to 10 degrees about each
axis and shifted by up to 5 mm along each from the pose that the hand expects, shifted by up to 20 mm along its axis,
with either end up, and rotated by any angle about its axis. It is held in place while the hand closes on it and
estimates its pose. Usually, the hand does not grip it well at first: the hand opens, the arm moves it so that the
pencil is in the middle of the grip, and it closes again. When the pencil is well placed and all five fingers carry
their share, it is released to the hand. If the first touch gives too little information, it is repeated with the pencil
offered elsewhere.

There is no vision and no prior: the pose is estimated from the five fingertips' forces alone. They determine the line
that the pencil lies on, but neither its position along the line nor which end is up. Therefore, the arm lowers it onto
the table, whose pose is known, until the fingertips feel that they carry less than its weight; then again with the tilt
that is most informative, until the position of the end is known to 2 mm, and which end it is to 98 %. The arm assumes
no bound on the shift: it begins the first lowering at a height of the pencil's length.

All of it is simulated with hydroelastic contact: the closing of the fingers, the motions of the arm, the table, the
insertion and the release. A trial succeeds if the pencil finally stands in the box, through the hole, and the right end
was identified.

[B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import argparse
import csv
import dataclasses
import math
from multiprocessing import get_context
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from hand_over_trial import HOLE_RADIUS, LONGEST, Trial, explain, run_trial
from pencil_hand_over import make_trial_station, plan_closing, write_collision_pencil
from pydrake.geometry import Meshcat, MeshcatParams
from rich.console import Console
from rich.progress import track
from rich.table import Table

from tactopose_drake.core.grasping import GraspPlan
from tactopose_drake.station import ArmStation
from tactopose_drake.visualization import save_html, set_stage


def save_plot(trials: list[Trial], path: Path) -> None:
    """Plots the errors of the touch, without and with the table, and where the pencils entered the hole."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(16, 4.5), layout="constrained")
    for good, colour, label in ((True, "tab:green", "in the hole, right end named"), (False, "tab:red", "failed")):
        chosen = [trial for trial in trials if trial.success == good]
        left.scatter([t.angle_deg for t in chosen], [t.end_mm for t in chosen], color=colour, label=label)
        middle.scatter([t.along_mm for t in chosen], [1.0 - t.upside_down for t in chosen], color=colour, label=label)
        right.scatter([t.sigma_mm for t in chosen], [t.hole_mm for t in chosen], color=colour, label=label)
    left.axhline(15.0, color="grey", linestyle="--")
    left.axvline(15.0, color="grey", linestyle="--", label="thesis: 15 mm or 15° jeopardise the task")
    left.set(
        xlabel="angle error of the axis, °", ylabel="error of the lower end across, mm", title="touch against truth"
    )
    middle.axhline(0.5, color="grey", linestyle="--")
    middle.set(
        xlabel="error of the lower end along the pencil, mm",
        ylabel="probability of the end that is up",
        ylim=(-0.03, 1.03),
        title="with the table",
    )
    right.axhline(1e3 * HOLE_RADIUS - 4.0, color="grey", linestyle="--", label="what the hole leaves")
    right.set(
        xlabel="stated standard deviation of the lower end, mm",
        ylabel="pencil's axis from the hole's at the rim, mm",
        title="at the hole, before the release",
    )
    for axes in (left, middle, right):
        axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


_of_process: list[tuple[GraspPlan, ArmStation]] = []


def _begin_process(closing: GraspPlan, pencil: Path) -> None:
    """Builds the station that all trials of a process use."""
    _of_process.append((closing, make_trial_station(closing, pencil)))


def _run_in_process(seed: int) -> Trial:
    return run_trial(*_of_process[0], seed)


def save_scene(closing: GraspPlan, pencil: Path, seed: int, path: Path, longest: float = LONGEST) -> Trial:
    """Runs one trial, and writes a page that replays it in any browser."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    station = make_trial_station(closing, pencil, meshcat)
    set_stage(meshcat, np.array([0.5, -0.1, 0.4]), 1.3, np.array([0.3, -1.0, 0.35]))
    meshcat.StartRecording()
    trial = run_trial(closing, station, seed, longest)
    meshcat.PublishRecording()
    save_html(path, meshcat)
    return trial


def read_trials(path: Path) -> list[Trial]:
    """The trials in a run's file, without an incomplete last line; none if there is no file."""
    if not path.exists():
        return []
    kinds = {field.name: field.type for field in dataclasses.fields(Trial)}
    with path.open(newline="") as file:
        whole = [
            row for row in csv.DictReader(file.read().rpartition("\n")[0].splitlines()) if row.keys() == kinds.keys()
        ]
    as_kind = {bool: "True".__eq__, int: int, float: float, str: str}
    return [Trial(**{name: as_kind[kinds[name]](text) for name, text in row.items()}) for row in whole]


def main() -> None:
    """Runs the trials and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/hand_over"))
    parser.add_argument("--resume", action="store_true", help="keep the trials that a run before wrote into trials.csv")
    parser.add_argument("--scene", action="store_true", help="replay the first trial in scene.html, and do no other")
    arguments = parser.parse_args()
    setting = (plan_closing(), write_collision_pencil(arguments.out / "model"))
    if arguments.scene:
        print_table([save_scene(*setting, arguments.first_seed, arguments.out / "scene.html")])
        return
    path = arguments.out / "trials.csv"
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    trials = [trial for trial in read_trials(path) if trial.seed in seeds] if arguments.resume else []
    seeds = [seed for seed in seeds if seed not in {trial.seed for trial in trials}]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in dataclasses.fields(Trial)])
        writer.writeheader()
        writer.writerows(dataclasses.asdict(trial) for trial in trials)
        file.flush()
        # Trials do not free all their memory, so each process runs only a few.
        with get_context("spawn").Pool(arguments.jobs, _begin_process, setting, maxtasksperchild=10) as pool:
            for trial in track(pool.imap(_run_in_process, seeds), total=len(seeds), description="trials"):
                trials.append(trial)
                writer.writerow(dataclasses.asdict(trial))
                file.flush()
    save_plot(trials, arguments.out / "figures_4_17_and_4_18.png")
    print_table(trials)


def print_table(trials: list[Trial]) -> None:
    """The summary, and every failure."""
    named = [trial for trial in trials if math.isfinite(trial.upside_down)]
    right = sum(trial.upside_down < 0.5 for trial in named)
    table = Table(
        caption=f"right end in {right} of the {len(named)} that were taken to the hole",
        title=f"{sum(t.success for t in trials)} of {len(trials)} pencils in the hole, right end named",
    )
    for heading in ("", "median", "95 %", "largest"):
        table.add_column(heading)
    for name, label in (
        ("angle_deg", "axis by touch, °"),
        ("end_mm", "lower end by touch, across the pencil, mm"),
        ("sigma_mm", "its stated standard deviation, mm"),
        ("along_mm", "lower end along the pencil, mm"),
        ("sigma_along_mm", "its stated standard deviation, mm"),
        ("upside_down", "probability of the wrong end up"),
        ("touches", "times that the pencil touched the table"),
        ("hole_mm", "axis from the hole's at the rim, mm"),
        ("turned_deg", "turned in the hand, °"),
        ("tries", "grips until one was firm"),
        ("met", "times that the arm met the pencil"),
        ("simulated", "simulated time, s"),
        ("cpu", "processor time, s"),
    ):
        values = np.array([getattr(trial, name) for trial in trials])
        values = values[np.isfinite(values)]
        if len(values):
            table.add_row(label, *(f"{np.quantile(values, q):.2f}" for q in (0.5, 0.95, 1.0)))
    console = Console()
    console.print(table)
    for trial in trials:
        if not trial.success:
            console.print(f"seed {trial.seed}: {explain(trial)}")


if __name__ == "__main__":
    main()
