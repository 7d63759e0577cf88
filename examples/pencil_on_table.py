"""A pencil's position along its axis in the hand, and which end is up, from touching a table.

    python examples/pencil_on_table.py --trials 100 --out out

After section 4.3.2.3 of [B16]. A pencil is handed over with random errors, as in `pencil_hand_over.py`: rotated,
shifted, also by up to 20 mm along its axis, with either end up, at any angle about its axis. Five fingertips feel it,
with noise, where the hand closes on it. They determine only the line that it lies on. Then the hand lowers it onto a
table until it touches, upright and tilted to both sides: each time, the pencil's lowest point, whichever it is, lies on
a plane that is known in the palm (`tp.PlaneContact`). The upright touch determines the position, but not the end. When
tilted, the blunt end touches with its rim and the sharp one with its tip, which distinguishes them. There is no vision,
no prior, and no bound on the shift.

The touches of the fingers and of the table are simulated by adding noise to the true ones, and the pencil does not move
in the hand; `hand_over_and_place.py` does it with an arm in the simulator. Prints, and writes as pencil_on_table.md and
.png, how often the right end is found and the lower end is known. A hundred pencils take about two minutes on one core.

[B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import dataclasses
import math
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pencil_hand_over import LENGTH, MASS, SLIDE, hand_over, plan_closing
from rich.console import Console

import tactopose_drake as tp
from tactopose_drake.core.grasping import GraspPlan
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.resources import model_path

Array = NDArray[np.float64]

SIGMA_POSITION, SIGMA_NORMAL = 0.0006, math.radians(8.0)  # of a fingertip, as in the simulated hand-over
SIGMA_TABLE = 0.0005  # of the lowest point's height above the table, m
LEAN = math.radians(45.0)
WAYS = {
    "five fingers alone": (),
    "and the table, upright": (0.0,),
    "and leaning to one side": (0.0, LEAN),
    "and to the other": (0.0, LEAN, -LEAN),
}
GOOD = 0.003  # largest error of the lower end along the pencil that is right, m


@dataclasses.dataclass(frozen=True)
class Trial:
    """The estimate of one pencil.

    Attributes:
        right_end: whether the most probable pose has the right end up.
        said: total probability of the hypotheses with the right end up.
        end: error of the lower end along the pencil, m.
    """

    right_end: bool
    said: float
    end: float


def feel(model: tp.ObjectModel, plan: GraspPlan, generator: np.random.Generator) -> tp.Contacts:
    """The points of the pencil that are nearest to the planned contacts, with noise."""
    X_PO = plan.X_PO
    p_OF = np.array([(part.p_PC - X_PO[:, 3]) @ X_PO[:, :3] for part in plan.fingers.values()])
    distance, n_O = model.grid.distance_and_normal(p_OF)
    p_PC = (p_OF - distance[:, None] * n_O) @ X_PO[:, :3].T + X_PO[:, 3]
    turn = exp_so3(SIGMA_NORMAL * generator.normal(size=n_O.shape))
    return tp.Contacts(
        p_PC + SIGMA_POSITION * generator.normal(size=p_PC.shape),
        np.einsum("kij,kj->ki", turn, n_O @ X_PO[:, :3].T),
        sigma_position=SIGMA_POSITION,
        sigma_normal=SIGMA_NORMAL,
    )


def lowest_end(X_PO: Array, down: Array) -> Array:
    """The end of the pencil's axis that is farthest along a direction, shape (3,), m."""
    ends = X_PO[:, 3] + np.array([[0.0], [LENGTH]]) * X_PO[:, 2]
    return np.asarray(ends[np.argmax(ends @ down)])


def table_touches(
    model: tp.ObjectModel, X_PO: Array, closing: GraspPlan, generator: np.random.Generator
) -> dict[float, tp.PlaneContact]:
    """The table's plane in the palm when the pencil touches it, for each tilt."""
    down, planes = -closing.X_PO[:, 2], {}
    across = np.cross(down, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    p_PV = model.vertices @ X_PO[:, :3].T + X_PO[:, 3]
    for lean in (0.0, LEAN, -LEAN):
        n_P = -exp_so3(lean * across) @ down
        lowest = p_PV[np.argmin(p_PV @ n_P)] + SIGMA_TABLE * generator.normal() * n_P
        planes[lean] = tp.PlaneContact(lowest, n_P, SIGMA_TABLE)
    return planes


def run_trial(model: tp.ObjectModel, closing: GraspPlan, seed: int) -> dict[str, Trial]:
    """Estimates one pencil from each set of touches."""
    generator = np.random.default_rng(seed)
    plan = hand_over(closing, generator)
    contacts = feel(model, plan, generator)
    planes = table_touches(model, plan.X_PO, closing, generator)
    down, axis = -closing.X_PO[:, 2], plan.X_PO[:, 2]
    end, trials = lowest_end(plan.X_PO, down), {}
    for way, leans in WAYS.items():
        estimate = tp.estimate_pose(model, contacts, planes=[planes[lean] for lean in leans])
        X_PO = np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in estimate])
        weight = np.array([hypothesis.probability for hypothesis in estimate])
        same = X_PO[:, :, 2] @ axis > 0.0
        off = (lowest_end(X_PO[0], down) - end) @ axis
        trials[way] = Trial(bool(same[0]), float(weight[same].sum()), abs(float(off)))
    return trials


def markdown(trials: list[dict[str, Trial]]) -> str:
    """A table with a row for each set of touches."""
    lines = [
        f"# Section 4.3.2.3: slide and end of {len(trials)} pencils",
        "",
        "| felt | right end | of the sure (95 %) right | lower end off, median, mm | 95 %, mm | end and place right |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for way in WAYS:
        rows = [trial[way] for trial in trials]
        sure = [row.right_end for row in rows if max(row.said, 1.0 - row.said) > 0.95]
        off = 1e3 * np.array([row.end for row in rows])
        both = sum(row.right_end and row.end < GOOD for row in rows)
        lines.append(
            f"| {way} | {sum(row.right_end for row in rows)} | {sum(sure)} of {len(sure)} | {np.median(off):.1f} | "
            f"{np.quantile(off, 0.95):.1f} | {both} |"
        )
    place = f"Place right: the lower end within {1e3 * GOOD:.0f} mm along the pencil, which had slid by up to "
    return "\n".join([*lines, "", f"{place}{1e3 * SLIDE:.0f} mm either way.", ""])


def plot(trials: list[dict[str, Trial]], path: Path) -> None:
    """Plots the error of the lower end along the pencil, and the probability of the right end."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    share = np.arange(1, len(trials) + 1) / len(trials)
    for way in WAYS:
        left.step(np.sort([1e3 * trial[way].end for trial in trials]), share, where="post", label=way)
        right.step(np.sort([trial[way].said for trial in trials]), share, where="post", label=way)
    left.set(xlabel="lower end off along the pencil, mm", ylabel="share of the pencils", xscale="symlog", xlim=(0, 200))
    right.set(xlabel="probability of the end that is up", ylabel="share of the pencils", xlim=(-0.02, 1.02))
    left.legend(loc="lower right", fontsize=8)
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=100, show_default=True, help="Pencils.")
@click.option("--first-seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the pencils.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the table and the plot here.")
def main(trials: int, first_seed: int, out: Path | None) -> None:
    """Tells the slide of a pencil and its end by setting it on a table."""
    model = tp.ObjectModel.from_mesh(model_path("objects", "pencil.obj"), mass=MASS)
    closing = plan_closing()
    results = [run_trial(model, closing, seed) for seed in range(first_seed, first_seed + trials)]
    text = markdown(results)
    Console().print(text, highlight=False, markup=False)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "pencil_on_table.md").write_text(text, encoding="utf-8")
        plot(results, out / "pencil_on_table.png")


if __name__ == "__main__":
    main()
