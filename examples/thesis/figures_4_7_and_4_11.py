"""Figures 4.7 and 4.11 of the thesis repeated: a pose that is corrected, and a pose found without a prior.

    python examples/thesis/figures_4_7_and_4_11.py --trial 0 --seed 0 --out out

Draws one trial of each experiment of section 4.3.1, with five fingers and the thesis' noise (see `grasp_trials.py`):
the bust from a displaced pose, and the wine glass without a prior. Both use the hand's volume, which is also drawn. In
figure 4.11 "the initial location was placed deliberately far away from the robot hand"; here it is drawn at a similar
distance, but not passed to the estimate. The script prints the errors of the poses, next to the thesis' means, and
writes them as Markdown (figures_4_7_and_4_11.md) with the pictures (figure_4_7.png, figure_4_11.png).

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.1.
"""

import math
from pathlib import Path

import click
import numpy as np
from grasp_library import Array, make_library, make_scenario
from grasp_trials import make_trial, pose_errors
from pose_experiments import CORRECTION, GLOBAL, MAIN_CELL, Experiment
from pydrake.math import RigidTransform

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.visualization import Scene, ShownHypothesis, save_picture, sphere_triangles

FIGURES = {"4.7": CORRECTION, "4.11": GLOBAL}
FAR = 0.2  # distance of the palm from the initial pose that is unrelated to the true one, m


def far_pose(generator: np.random.Generator) -> Array:
    """A random pose (3, 4) whose origin has this distance from the palm's."""
    way = generator.normal(size=(1, 3))
    X_PO: Array = make_poses(random_rotations(generator, 1), FAR * way / np.linalg.norm(way))[0]
    return X_PO


def draw(figure: str, experiment: Experiment, number: int, seed: int, path: Path) -> str:
    """Draws a trial of an experiment, and describes its result."""
    grasp = make_library(experiment.object, number + 1)[number]
    model = make_scenario(experiment.object).object_model()
    trial = make_trial(experiment.object, grasp, MAIN_CELL.fingers, MAIN_CELL.noise, (seed, number), experiment.guess)
    estimate = tp.estimate_pose(model, trial.contacts, prior=trial.prior, hand=trial.hand)
    best = estimate.best.X_PO
    before = far_pose(np.random.default_rng((seed, number))) if trial.prior is None else trial.prior.mean
    scene = Scene(
        model=model,
        contacts=tp.Contacts(grasp.p_PC, grasp.n_PC, grasp.f_PC),
        prior=RigidTransform(before),
        hypotheses=(ShownHypothesis(best),),
        truth=RigidTransform(grasp.X_PO),
        hand=sphere_triangles(grasp.p_PH, grasp.radius),
    )
    if trial.prior is None:
        start, label = "a pose far away, not used", "initial pose"
    else:
        start, label = "the displaced pose", "prior"
    save_picture(path, scene, captions=(f"before: {start}", "after: touch"), prior_label=label)
    initial, final = (
        f"{1e3 * errors.translation[0]:.1f} mm and {math.degrees(errors.rotation[0]):.1f}°"
        for errors in (pose_errors(model, X_PO[None], grasp.X_PO) for X_PO in (before, best.GetAsMatrix34()))
    )
    return (
        f"- Figure {figure}, the {experiment.object.replace('_', ' ')}: {start}: {initial} off; the estimate: {final} "
        f"off (the thesis' mean over its trials: {1e3 * experiment.mean_translation:.3g} mm and "
        f"{math.degrees(experiment.mean_rotation):.3g}°)."
    )


@click.command()
@click.option("--trial", "number", type=click.IntRange(min=0), default=0, show_default=True, help="Which one is drawn.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of noise and displacements."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True, help="Folder.")
def main(number: int, seed: int, out: Path) -> None:
    """Figures 4.7 and 4.11 of the thesis repeated."""
    out.mkdir(parents=True, exist_ok=True)
    lines = [f"# Figures 4.7 and 4.11, trial {number}, seed {seed}", ""]
    for figure, experiment in FIGURES.items():
        lines.append(draw(figure, experiment, number, seed, out / f"figure_{figure.replace('.', '_')}.png"))
    print("\n".join(lines))
    (out / "figures_4_7_and_4_11.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
