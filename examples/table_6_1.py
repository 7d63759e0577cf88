"""The columns of the thesis' table 6.1, each demonstrated by an experiment.

    python examples/table_6_1.py --trials 50 --seed 0 --out out

The thesis compares methods by their capabilities: poses in six degrees of freedom, complex objects, no need of a prior,
no exploration, identification of the object, and objects that move in the hand. Here, a column is ticked if its
experiment succeeds in as many trials as the thesis requires of its own (75 %, section 4.3.1.2). Prints the experiments
and the table with the thesis' rows, its own and those of ten earlier works, and writes both as Markdown (table_6_1.md).
The thesis' run times are "merely indicative", because they are from different machines; so are these. The ten works
used real hands; the experiments here are simulated.

Touches are synthetic, with five contacts at random places, 0.9 mm and 5 degrees of noise; moving objects are those of
the family `carry` of `motion_families.py`. Errors are means over the successful trials, and times are median CPU times.
All poses have six degrees of freedom, and all contacts are from one grasp, without exploration.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, tables 2.1 and 6.1.
"""

import functools
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from motion_trial import run_motion
from numpy.typing import NDArray
from rich.progress import track

import tactopose_drake as tp
from tactopose_drake.core.poses import compose, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.shape import turn_toward
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

Array = NDArray[np.float64]

COMPLEX = ("bust", "spray_bottle", "screwdriver", "light_bulb")
MOST_TRANSLATION, MOST_ROTATION = 0.010, math.radians(15.0)  # limits of a success, m and rad [B16, section 4.3.1]
NEEDED = 0.75
STEPS = 100  # number of steps of a motion, 10 ms each
# The earlier works in the thesis' tables 2.1 and 6.1; the numbers in brackets are its references, and its section 2.4
# describes the works. A dash means that the thesis gives no value.
LITERATURE = {
    "Aggarwal [90], underwater exploration, RANSAC, ICP, particle filter": ((1, 1, 1, 0, 1, 1), "<5/-", "-"),
    "Chalon [131], particle filter from vision's pose": ((1, 0, 0, 0, 0, 1), "≈10/10", "-"),
    "Corcoran [129], touches and what is not touched": ((0, 0, 0, 0, 0, 0), "≈3/8", "3"),
    "Hebert [128], stereo, forces and joints in an EKF": ((1, 0, 0, 1, 0, 1), "6/2", "-"),
    "Honda [124], projected light and fingertips": ((1, 0, 0, 1, 0, 1), "0.5/2", "0.033"),
    "Petrovskaya [127], Scaling Series with a probe": ((1, 0, 1, 0, 0, 1), "5/3", "30"),
    "Koval [132], manifold particle filter": ((0, 0, 1, 0, 0, 1), "<20/-", "1"),
    "Laaksonen [135], Gaussian processes of grasps": ((0, 0, 0, 0, 0, 0), "-/-", "-"),
    "Zito [133], arm's paths that tell poses apart": ((1, 1, 0, 0, 0, 0), "-/-", "200"),
    "Pezzementi [137], maps of tactile images": ((1, 1, 1, 0, 1, 0), "4/≈30", "-"),
}
# The references of these works, as identified from the thesis' description.
WORKS = {
    90: "A. Aggarwal and F. Kirchner, Object recognition and localization: the role of tactile sensors, Sensors, 2014",
    124: "K. Honda et al., Real-time pose estimation of an object manipulated by multi-fingered hand using 3D stereo "
    "vision and tactile sensing, IROS, 1998",
    127: "A. Petrovskaya and O. Khatib, Global localization of objects via touch, IEEE Trans. Robotics, 2011",
    128: "P. Hebert et al., Fusion of stereo vision, force-torque, and joint sensors for estimation of in-hand object "
    "location, ICRA, 2011",
    129: "C. Corcoran and R. Platt, A measurement model for tracking hand-object state during dexterous manipulation, "
    "ICRA, 2010",
    131: "M. Chalon, J. Reinecke and M. Pfanne, Online in-hand object localization, IROS, 2013",
    132: "M. Koval et al., Pose estimation for contact manipulation with manifold particle filters, IROS, 2013",
    133: "C. Zito et al., Sequential trajectory re-planning with tactile information gain for dexterous grasping under "
    "object-pose uncertainty, IROS, 2013",
    135: "J. Laaksonen, E. Nikandrova and V. Kyrki, Probabilistic sensor-based grasping, IROS, 2012",
    137: "Z. Pezzementi, C. Reyda and G. Hager, Object mapping, recognition, and localization from tactile geometry, "
    "ICRA, 2011",
}
# [B16] table 6.1: 6-DOF, complex objects, global pose, no exploration, identification, moving object; mm/deg; s.
COLUMNS = ("6-DOF", "complex objects", "global pose", "no exploration", "identification", "moving object")
THESIS = {
    "thesis, chapter 3": ((1, 1, 0, 1, 0, 0), "20/-", "0.17"),
    "thesis, chapter 4, local": ((1, 1, 0, 1, 0, 0), "4/5", "0.64"),
    "thesis, chapter 4, global": ((1, 1, 1, 1, 1, 0), "7/3", "63"),
    "thesis, chapter 5, local": ((1, 1, 0, 1, 0, 0), "7.6/10.4", "9.7"),
    "thesis, chapter 5, global": ((1, 1, 1, 1, 1, 0), "-/-", "60"),
}


class Trial(NamedTuple):
    """The result of one trial: errors in m and rad, NaN without a pose; CPU time in s."""

    succeeded: bool
    translation: float
    rotation: float
    seconds: float


class Experiment(NamedTuple):
    """The summary of an experiment's trials."""

    name: str
    columns: tuple[str, ...]
    share: float
    accuracy: str
    seconds: float

    @property
    def succeeded(self) -> bool:
        """Whether its columns are ticked."""
        return self.share >= NEEDED


@functools.cache
def load(name: str) -> tp.ObjectModel:
    """An object of the package, loaded once, because a model caches what its first estimate has prepared."""
    return tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))


def random_pose(generator: np.random.Generator) -> Array:
    """A random orientation, at a position some centimetres from the palm's origin."""
    return make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]


def judge_pose(model: tp.ObjectModel, X_PO: Array, X_true: Array, seconds: float) -> Trial:
    """Compares a pose with the truth, up to the object's symmetries."""
    alike = turn_toward(compose(X_PO[None], model.symmetry_poses), X_true, model.symmetries)
    off = increments_between(alike, X_true[None])
    moved, turned = np.linalg.norm(off[:, 3:], axis=1), np.linalg.norm(off[:, :3], axis=1)
    i = int(np.argmin(moved / MOST_TRANSLATION + turned / MOST_ROTATION))
    succeeded = bool(moved[i] < MOST_TRANSLATION and turned[i] < MOST_ROTATION)
    return Trial(succeeded, float(moved[i]), float(turned[i]), seconds)


def find_pose(trial: int, seed: int, has_guess: bool) -> Trial:
    """Estimates a complex object's pose from the contacts of one grasp."""
    generator = np.random.default_rng((seed, trial))
    model = load(COMPLEX[trial % len(COMPLEX)])
    X_PO = random_pose(generator)
    contacts = touch_surface(model, X_PO, 5, generator)
    guess = tp.PosePrior(X_PO)
    guess = tp.PosePrior(retract(X_PO, generator.normal(size=6) * guess.sigmas))
    started = time.process_time()
    estimate = tp.estimate_pose(model, contacts, prior=guess if has_guess else None)
    seconds = time.process_time() - started
    return judge_pose(model, estimate.best.X_PO.GetAsMatrix34(), X_PO, seconds)


def name_object(trial: int, seed: int) -> Trial:
    """Identifies one of the package's objects."""
    generator = np.random.default_rng((seed, trial))
    names = sorted(path.stem for path in model_path("objects").glob("*.obj"))
    models = [load(name) for name in names]
    touched = int(generator.integers(len(models)))
    contacts = touch_surface(models[touched], random_pose(generator), 5, generator)
    started = time.process_time()
    found = tp.identify(models, contacts)
    return Trial(found.best.name == names[touched], math.nan, math.nan, time.process_time() - started)


def follow(trial: int, seed: int) -> Trial:
    """Tracks an object; gives the errors at the motion's end, and the median time of an update."""
    instants = run_motion("carry", seed * 10_000 + trial, STEPS)
    last = instants[-1]
    succeeded = last.translation < MOST_TRANSLATION and last.rotation < MOST_ROTATION
    return Trial(
        succeeded, last.translation, last.rotation, float(np.median([instant.seconds for instant in instants]))
    )


def run(
    name: str, columns: tuple[str, ...], trial_of: Callable[[int, int], Trial], trials: int, seed: int
) -> Experiment:
    """Runs an experiment, after some trials that compile code and prepare models."""
    for trial in range(len(COMPLEX)):
        trial_of(trial, seed)
    ended = [trial_of(trial, seed) for trial in track(range(trials), description=name, transient=True)]
    errors = np.array([(trial.translation, trial.rotation) for trial in ended if trial.succeeded]).reshape(-1, 2)
    accuracy = "-/-"
    if len(errors) and np.isfinite(errors).all():
        translation, rotation = errors.mean(axis=0)
        accuracy = f"{1e3 * translation:.1f}/{math.degrees(rotation):.1f}"
    share = float(np.mean([trial.succeeded for trial in ended]))
    return Experiment(name, columns, share, accuracy, float(np.median([trial.seconds for trial in ended])))


def experiments(trials: int, seed: int) -> list[Experiment]:
    """Runs the four experiments."""
    return [
        run("with a guess", COLUMNS[:2] + COLUMNS[3:4], lambda i, s: find_pose(i, s, True), trials, seed),
        run("without a guess", COLUMNS[:4], lambda i, s: find_pose(i, s, False), trials, seed),
        run("which object", COLUMNS[3:5], name_object, trials, seed),
        run("moving object", (*COLUMNS[:2], COLUMNS[3], COLUMNS[5]), follow, trials, seed),
    ]


def markdown(made: list[Experiment], trials: int, seed: int) -> str:
    """The experiments and the table as Markdown."""
    lines = [f"# Table 6.1, {trials} trials of each experiment, seed {seed}", ""]
    lines += ["| experiment | succeeded, % | mm/deg | s |", "|---|---:|---:|---:|"]
    lines += [f"| {one.name} | {100 * one.share:.0f} | {one.accuracy} | {one.seconds:.4f} |" for one in made]
    lines += ["", "| method | " + " | ".join(COLUMNS) + " | mm/deg | s |", "|---|" + ":-:|" * 6 + "---:|---:|"]

    def row(name: str, ticked: list[bool], accuracy: str, seconds: str) -> str:
        return f"| {name} | " + " | ".join("✓" if tick else "×" for tick in ticked) + f" | {accuracy} | {seconds} |"

    for name, (ticks, accuracy, seconds) in (LITERATURE | THESIS).items():
        lines.append(row(name, [bool(tick) for tick in ticks], accuracy, seconds))
    for one in made:
        ticked = [one.succeeded and column in one.columns for column in COLUMNS]
        lines.append(row(f"here, {one.name}", ticked, one.accuracy, f"{one.seconds:.4f}"))
    shown = [any(one.succeeded and column in one.columns for one in made) for column in COLUMNS]
    lines.append(row("here, all", shown, "", ""))
    most = max(sum(ticks) for ticks, _, _ in (LITERATURE | THESIS).values())
    lines += [
        "",
        f"- {sum(shown)} of the {len(COLUMNS)} columns are ticked here; at most {most} by another row.",
        "- The rows of the ten works and of the thesis are the thesis' own (tables 2.1 and 6.1; in brackets its "
        "references): of other objects and hands, and not run here.",
        *(f"- [{number}] {work}." for number, work in WORKS.items()),
    ]
    return "\n".join(lines) + "\n"


@click.command()
@click.option("--trials", type=click.IntRange(min=1), default=50, show_default=True, help="Of each experiment.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all random numbers.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown here.")
def main(trials: int, seed: int, out: Path | None) -> None:
    """The columns of the thesis' table 6.1, each shown by an experiment of its own."""
    text = markdown(experiments(trials, seed), trials, seed)
    print(text)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "table_6_1.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
