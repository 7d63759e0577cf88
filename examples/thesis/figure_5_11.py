"""Figure 5.11 of the thesis repeated: the cost of a held bottle that is rotated about the vertical.

    python examples/thesis/figure_5_11.py --out out

Prints the rotation at which each cost is least, next to what the thesis reads from its figure, and writes the figure
(figure_5_11.png). The grip is that of the lying bottle of table 5.3 (see `pad_grasps.py`), which is kept in the cache
folder.

As in the thesis, the object is rotated from its true pose by up to 57 deg in both directions about the palm's normal
through the palm's centre, and evaluated by algorithm 5.2 ("PCA"), algorithm 5.3 ("distance") and our likelihood of the
cells.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 5.3.2.
"""

from pathlib import Path

import click
import numpy as np
from matplotlib.figure import Figure
from pad_grasps import DISTANCE, GRIPS, OURS, PCA, Array, PadGrasp, load_pad_grasp
from rich.console import Console

from tactopose_drake.core.poses import exp_so3, transform_points

METHODS = (PCA, DISTANCE, OURS)
TURNS_DEG = np.linspace(-57.0, 57.0, 229)
SHOWN_DEG = (-57.0, -28.5, 0.0, 28.5, 57.0)
THESIS_DEG = {PCA: 0.0, DISTANCE: 20.0}  # approximate rotations at which the thesis' costs are least
GRIP = "f) thermal bottle, lying"


def turned_poses(grasp: PadGrasp, degrees: Array) -> Array:
    """The true pose rotated about P's z axis, shape (n, 3, 4)."""
    turned: Array = exp_so3(np.radians(degrees)[:, None] * np.array([0.0, 0.0, 1.0])) @ grasp.X_PO
    return turned


def turned_costs(grasp: PadGrasp) -> dict[str, Array]:
    """Each method's cost at `TURNS_DEG`."""
    X_PO = turned_poses(grasp, TURNS_DEG)
    return {method: grasp.objectives[method].cost(X_PO) for method in METHODS}


def verdicts(costs: dict[str, Array]) -> list[str]:
    """Sentences that state where each cost is least."""
    lines = []
    for method, cost in costs.items():
        thesis = f" (thesis: about {THESIS_DEG[method]:g} deg)" if method in THESIS_DEG else ""
        lines.append(f"{method}: least at {TURNS_DEG[cost.argmin()]:.1f} deg{thesis}.")
    return lines


def plot(grasp: PadGrasp, costs: dict[str, Array], path: Path) -> None:
    """Plots the poses from above, and the costs in the same colours."""
    figure = Figure(figsize=(12, 9), layout="constrained")
    above, *below = figure.subplots(2, 2).ravel()
    colors = blue_to_red(len(TURNS_DEG))
    for degrees in SHOWN_DEG:
        points = transform_points(turned_poses(grasp, np.array([degrees]))[0], grasp.model.samples.points)
        color = colors[int(np.abs(TURNS_DEG - degrees).argmin())]
        above.plot(*(1e3 * points[:, :2].T), ".", markersize=1.5, color=color, label=f"{degrees:g} deg")
    cells = np.concatenate([patch.points[patch.active] for patch in grasp.patches])
    above.plot(*(1e3 * cells[:, :2].T), "kx", markersize=4, label="active cells")
    above.set(title="poses, seen along the palm's normal", xlabel="x, mm", ylabel="y, mm", aspect="equal")
    above.legend(loc="upper left", fontsize=8, markerscale=3)
    for axes, (method, cost) in zip(below, costs.items(), strict=True):
        axes.scatter(TURNS_DEG, cost, s=8, c=colors)
        axes.axvline(float(TURNS_DEG[cost.argmin()]), color="0.7", linewidth=0.8)
        axes.set(title=method, xlabel="turn about the vertical, deg", ylabel="cost")
    figure.savefig(path, format="png")


def blue_to_red(count: int) -> Array:
    """Colours from blue to red, shape (count, 3)."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return (1.0 - share) * np.array([0.12, 0.47, 0.71]) + share * np.array([0.84, 0.15, 0.16])


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--out", type=click.Path(path_type=Path), help="Writes the figure here.")
def main(out: Path | None) -> None:
    """Regenerates figure 5.11 of the thesis."""
    grasp = load_pad_grasp(GRIP, GRIPS[GRIP])
    costs = turned_costs(grasp)
    console = Console()
    console.print(f"Figure 5.11, grip {GRIP}")
    for line in verdicts(costs):
        console.print(f"- {line}")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        plot(grasp, costs, out / "figure_5_11.png")


if __name__ == "__main__":
    main()
