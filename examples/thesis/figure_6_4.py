"""Figure 6.4 of the thesis repeated, with the exploration that it asks for if several poses explain a grasp.

    python examples/thesis/figure_6_4.py --grasps 100 --out out

The thesis shows a grasp that two poses explain about equally well, and says that only exploration could distinguish
them, and that exploration must not destabilise the grasp. The script shows such a grasp, with the two poses (blue and
green), the true one (pink), and the finger motion with the most expected information (figure_6_4.html; the poses next
to each other in figure_6_4.png). It then studies ambiguous grasps: it counts the touches until one pose is left, when
the next touch is chosen by its expected information, and when it is chosen at random among the same motions
(figure_6_4_touches.png, figure_6_4.md). `touch_study.py` defines the terms.

A hundred grasps take about twelve minutes of one core.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 6.3.
"""

import itertools
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat, MeshcatParams, Rgba, Sphere
from pydrake.math import RigidTransform
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table
from touch_study import (
    CHOOSERS,
    FRICTION,
    MOST_TOUCHES,
    OBJECTS,
    Exploration,
    Grasp,
    ambiguous_grasps,
    explore,
    sample_moves,
)

import tactopose_drake as tp
from tactopose_drake.core.exploration import Hold, choose_touch, merged_modes
from tactopose_drake.core.posterior import GaussianMixture
from tactopose_drake.visualization import (
    Scene,
    ShownHypothesis,
    add_object,
    add_touch,
    move_touch,
    save_html,
    save_picture,
    set_stage,
    sphere_triangles,
)

BLUE, GREEN, PINK = Rgba(0.2, 0.35, 0.9, 0.45), Rgba(0.15, 0.7, 0.3, 0.45), Rgba(0.95, 0.45, 0.7, 0.9)
ORANGE = Rgba(0.95, 0.6, 0.1, 1.0)

ABOUT_AS_WELL = 0.25  # minimum probability of the second pose of the grasp that is shown

Runs = dict[str, dict[str, list[Exploration]]]  # by object, by chooser


def study(grasps: int, first_seed: int) -> Runs:
    """Explores a number of ambiguous grasps, divided among the objects, with each chooser."""
    runs: Runs = {}
    for index, name in enumerate(OBJECTS):
        count = (grasps + len(OBJECTS) - 1 - index) // len(OBJECTS)
        runs[name] = {chooser: [] for chooser in CHOOSERS}
        found = itertools.islice(ambiguous_grasps(name, first_seed), count)
        for seed, (grasp, estimate) in enumerate(
            track(found, description=name, total=count, console=Console(stderr=True), transient=True)
        ):
            for chooser, choose in CHOOSERS.items():
                runs[name][chooser].append(explore(grasp, estimate, choose, seed))
    return runs


def touches(explorations: list[Exploration]) -> np.ndarray:
    """The number of touches; the maximum that was tried if the pose was not unique by then."""
    return np.array([run.touches or MOST_TOUCHES for run in explorations], dtype=np.intp)


def rows(runs: Runs) -> list[tuple[str, ...]]:
    """For each object and all together: grasps, mean touches, how many ended unique, and how many of these right."""
    everything = {chooser: [run for name in runs for run in runs[name][chooser]] for chooser in CHOOSERS}
    lines = []
    for name, by_chooser in (runs | {"all": everything}).items():
        for chooser, explorations in by_chooser.items():
            ended = [run for run in explorations if run.touches is not None]
            lines.append(
                (
                    name,
                    str(len(explorations)),
                    chooser,
                    f"{touches(explorations).mean():.2f}" if explorations else "",
                    f"{len(ended)}",
                    f"{sum(run.right for run in ended)}",
                )
            )
    return lines


HEADINGS = ("object", "grasps", "next touch", "mean touches", "ended unique", "of these right")


def verdict(runs: Runs) -> str:
    """The ratio of the means, with its standard error over the grasps."""
    by_information, at_random = (
        np.concatenate([touches(runs[name][chooser]) for name in runs]) for chooser in CHOOSERS
    )
    ratio = by_information.mean() / at_random.mean()
    residual = by_information - ratio * at_random
    error = residual.std(ddof=1) / np.sqrt(len(residual)) / at_random.mean() if len(residual) > 1 else np.nan
    return (
        f"{len(at_random)} ambiguous grasps: {by_information.mean():.2f} touches by information, "
        f"{at_random.mean():.2f} at random; the ratio is {ratio:.2f} +- {error:.2f}."
    )


def markdown(runs: Runs) -> str:
    """The table and the verdict as Markdown."""
    lines = [
        "# Figure 6.4: touches until the pose is unique",
        "",
        "| " + " | ".join(HEADINGS) + " |",
        "|---|---:|---|---:|---:|---:|",
    ]
    lines += ["| " + " | ".join(row) + " |" for row in rows(runs)]
    return "\n".join([*lines, "", verdict(runs), ""])


def plot(runs: Runs, path: Path) -> None:
    """Plots a histogram of the number of touches."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    axis = figure.add_subplot()
    for shift, (chooser, colour) in zip((-0.2, 0.2), zip(CHOOSERS, ("tab:blue", "tab:gray"), strict=True), strict=True):
        counts = np.bincount(
            np.concatenate([touches(runs[name][chooser]) for name in runs]), minlength=MOST_TOUCHES + 1
        )
        axis.bar(np.arange(len(counts)) + shift, counts, 0.4, label=chooser, color=colour)
    axis.set(xlabel=f"touches until 95 % lie about one pose ({MOST_TOUCHES}: or more)", ylabel="grasps")
    axis.legend()
    FigureCanvasAgg(figure).print_png(path)


def first_grasp() -> tuple[Grasp, tp.PoseEstimate]:
    """The ambiguous grasp that is shown: the first of the first object that a second pose explains about as well."""
    for grasp, estimate in ambiguous_grasps(OBJECTS[0]):
        weights = merged_modes(grasp.model, estimate.modes).weights
        if len(weights) > 1 and weights[1] >= ABOUT_AS_WELL:
            return grasp, estimate
    raise AssertionError("there is no end of grasps")


def show(meshcat: Meshcat, grasp: Grasp, belief: GaussianMixture) -> str:
    """Draws the two most probable poses, the true one and the most informative motion; returns a description."""
    for path, X, rgba in zip(("blue", "green"), belief.X_PO, (BLUE, GREEN), strict=False):
        add_object(meshcat, f"/{path}", grasp.model, "estimate", 0.45)
        meshcat.SetProperty(f"/{path}", "color", [rgba.r(), rgba.g(), rgba.b(), rgba.a()])
        meshcat.SetTransform(f"/{path}", RigidTransform(X))
    add_object(meshcat, "/true", grasp.model, "truth", 0.9)
    meshcat.SetProperty("/true", "color", [PINK.r(), PINK.g(), PINK.b(), PINK.a()])
    meshcat.SetTransform("/true", RigidTransform(grasp.X_PO))
    add_touch(meshcat, "/touch", len(grasp.contacts))
    move_touch(meshcat, "/touch", grasp.contacts, len(grasp.contacts))
    moves = sample_moves(grasp, np.random.default_rng(0))
    found = choose_touch(grasp.model, Hold(grasp.contacts, grasp.fingers, FRICTION), belief, moves)
    set_stage(meshcat, grasp.X_PO @ [*grasp.model.center_of_mass, 1.0], 0.22, np.array([0.7, -0.6, 0.5]))
    masses = " and ".join(f"{share:.0%}" for share in belief.weights[:2])
    if found is None:
        return f"{grasp.model.name}: the two most probable poses carry {masses}; no motion is allowed."
    move = moves[found.finger].take(np.array([found.move]))
    felt = move.feel(grasp.model, np.concatenate([belief.X_PO[:2], grasp.X_PO[None]]))
    ways = [
        f"{1e3 * way:.0f} mm" if hit else "never" for way, hit in zip(felt.way[:, 0], felt.is_hit[:, 0], strict=True)
    ]
    for place, p_PT in enumerate(move.tip[0]):
        meshcat.SetObject(f"/move/{place}", Sphere(0.0015), ORANGE)
        meshcat.SetTransform(f"/move/{place}", RigidTransform(p_PT))
    return (
        f"{grasp.model.name}: the two most probable poses carry {masses}. The {found.finger} finger tells most: it "
        f"meets the first after {ways[0]}, the second after {ways[1]}, the true one after {ways[2]}. "
        f"Expected entropy {found.entropy:.2f} to {found.expected_entropy:.2f} nats."
    )


def save_poses(path: Path, grasp: Grasp, belief: GaussianMixture) -> None:
    """Saves a picture of the two most probable poses next to each other, with the outline of the true one."""
    first, second = (RigidTransform(X_PO) for X_PO in belief.X_PO[:2])
    scene = Scene(
        model=grasp.model,
        contacts=grasp.contacts,
        prior=second,
        hypotheses=(ShownHypothesis(first),),
        truth=RigidTransform(grasp.X_PO),
        hand=sphere_triangles(grasp.hand.p_PH, grasp.hand.radius),
    )
    captions = f"another pose: {belief.weights[1]:.0%}", f"the most probable pose: {belief.weights[0]:.0%}"
    save_picture(path, scene, captions=captions, prior_label="another pose")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--grasps", type=click.IntRange(min=0), default=100, show_default=True, help="Ambiguous grasps in all.")
@click.option("--first-seed", type=click.IntRange(min=0), default=0, show_default=True, help="First seed of grasps.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the table, the plot and the scene here.")
def main(grasps: int, first_seed: int, out: Path | None) -> None:
    """Shows an ambiguous grasp, and counts the touches until the poses of such grasps are unique."""
    console, meshcat = Console(), Meshcat(MeshcatParams(host="localhost"))
    grasp, estimate = first_grasp()
    belief = merged_modes(grasp.model, estimate.modes)
    console.print(show(meshcat, grasp, belief), highlight=False)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        save_html(out / "figure_6_4.html", meshcat)
        save_poses(out / "figure_6_4.png", grasp, belief)
    if not grasps:
        return
    runs = study(grasps, first_seed)
    table = Table(title="Touches until the pose is unique", box=box.SIMPLE_HEAD)
    for heading in HEADINGS:
        table.add_column(heading)
    for row in rows(runs):
        table.add_row(*row)
    console.print(table)
    console.print(verdict(runs), highlight=False)
    if out is not None:
        (out / "figure_6_4.md").write_text(markdown(runs), encoding="utf-8")
        plot(runs, out / "figure_6_4_touches.png")


if __name__ == "__main__":
    main()
