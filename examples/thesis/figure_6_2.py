"""Figure 6.2 of the thesis repeated: a light bulb in the five-fingered hand, and the wrenches that the grasp resists.

    python examples/thesis/figure_6_2.py --out out

The hand grasps the bulb in the simulator. The fingertips' wrenches give the contacts, and together with a prior from
vision the pose. The script prints the quality of the grasp at the estimated pose, at the true one, and over all
hypotheses. It draws the hand with the contacts' forces and normals, and next to it the forces (green) and torques (red)
that the grasp can exert (figure_6_2.html; as pictures figure_6_2.png and figure_6_2_wrenches.png). It takes about ten
seconds.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 6.2.2.
"""

import dataclasses
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform
from rich import box
from rich.console import Console
from rich.table import Table

import tactopose_drake as tp
from tactopose_drake.cli import DemoResult, run_demo
from tactopose_drake.station import load_scenario
from tactopose_drake.visualization import draw_scene, draw_wrench_space, save_html, save_picture, set_stage, upright

FRICTION = 0.6
SCALE = 0.06  # length of 1 N in the scene, m
# Positions next to the upright grasp, m.
BESIDE = {
    "force": np.array([0.0, 0.18, 0.06]),
    "torque": np.array([0.0, 0.18, -0.08]),
}


def grasp_bulb(seed: int) -> DemoResult:
    """Simulates the grasp by a hand without errors, and estimates the pose from it."""
    scenario = load_scenario("shadow_like").without_errors()
    scenario.object, scenario.seed = "light_bulb", seed
    return run_demo(scenario)


def judge(result: DemoResult) -> dict[str, tp.GraspQuality]:
    """The quality at the estimated and at the true pose, for both norms; the task is to carry a weight."""
    scene = result.scene
    weight = np.concatenate([np.zeros(3), -scene.up_P])[None]
    assert scene.estimate is not None
    assert scene.truth is not None
    return {
        f"{name}, {norm}": tp.grasp_quality(scene.model, scene.contacts, X, friction=FRICTION, norm=norm, task=weight)
        for name, X in (("estimate", scene.estimate), ("truth", scene.truth))
        for norm in ("L1", "Linf")
    }


def print_numbers(result: DemoResult, qualities: dict[str, tp.GraspQuality], console: Console) -> None:
    """Prints the qualities, and the probability of force closure."""
    table = Table(title=f"The light bulb by {len(result.scene.contacts)} fingertips", box=box.SIMPLE_HEAD)
    for heading in ("pose, norm", "force closure", "radius, N", "volume, N^6", "weight carried, N per N"):
        table.add_column(heading)
    for name, quality in qualities.items():
        volume = f"{quality.volume:.4f}" if quality.space.norm == "L1" else ""
        assert quality.task_scale is not None
        row = (str(quality.force_closure), f"{quality.radius:.4f}", volume, f"{quality.task_scale:.3f}")
        table.add_row(name, *row)
    console.print(table)
    assert result.estimate is not None
    closure = tp.force_closure_probability(
        result.scene.model, result.scene.contacts, result.estimate.modes, friction=FRICTION
    )
    console.print(
        f"Force closure with probability {closure.value:.3f} +- {closure.standard_error:.3f} over "
        f"{len(result.estimate.hypotheses)} hypotheses. Torques are over {1e3 * qualities['truth, L1'].length:.1f} mm.",
        highlight=False,
    )


def draw(result: DemoResult, quality: tp.GraspQuality) -> Meshcat:
    """Draws the grasp, and next to it the projections of the wrench space."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    draw_scene(meshcat, dataclasses.replace(result.scene, prior=None, friction=FRICTION))
    draw_wrench_space(meshcat, "/tactopose/wrenches", quality.space, scale=SCALE)
    assert result.scene.estimate is not None
    X_WP = upright(result.scene)
    grasp_W = X_WP @ result.scene.estimate @ quality.p_OC.mean(axis=0)
    R_WO = X_WP.rotation() @ result.scene.estimate.rotation()
    for part, place in BESIDE.items():
        X_WHull = RigidTransform(R_WO, grasp_W + place)
        meshcat.SetTransform(f"/tactopose/wrenches/{part}s", X_WP.inverse() @ X_WHull)
    set_stage(meshcat, grasp_W + BESIDE["force"] / 2, 0.4, np.array([1.0, 0.3, 0.35]))
    return meshcat


def plot(quality: tp.GraspQuality, path: Path) -> None:
    """Plots the projections, with the ball of the radius."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    for column, (part, colour) in enumerate((("force", "#009e73"), ("torque", "#d55e00"))):
        axis = figure.add_subplot(1, 2, column + 1, projection="3d")
        hull = quality.space.projection(part)  # type: ignore[arg-type]
        if hull is not None:
            triangles = hull.vertices[hull.simplices]
            axis.add_collection3d(
                Poly3DCollection(triangles, facecolor=colour, edgecolor="k", linewidth=0.2, alpha=0.3)
            )
        u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 24), np.linspace(0, np.pi, 12))
        ball = quality.radius * np.array([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
        axis.plot_wireframe(*ball, color="k", linewidth=0.5)
        unit = "N" if part == "force" else f"N over {1e3 * quality.length:.0f} mm"
        labels = {f"{letter}label": f"{letter}, {unit}" for letter in "xyz"}
        axis.set(title=f"{part}s; radius {quality.radius:.3f}", **labels)
        reach = 1.0 if hull is None else float(np.abs(hull.vertices).max())
        axis.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-reach, reach))
        axis.set_box_aspect((1, 1, 1))
        axis.locator_params(nbins=5)
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the grasp.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the scene and the plot here.")
def main(seed: int, out: Path | None) -> None:
    """Grasps a light bulb in the simulator and evaluates the quality of the grasp."""
    result = grasp_bulb(seed)
    qualities = judge(result)
    print_numbers(result, qualities, Console())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        save_html(out / "figure_6_2.html", draw(result, qualities["estimate, L1"]))
        alone = dataclasses.replace(result.scene, prior=None)
        save_picture(out / "figure_6_2.png", alone, captions=("", "the light bulb at the estimated pose"))
        plot(qualities["estimate, L1"], out / "figure_6_2_wrenches.png")


if __name__ == "__main__":
    main()
