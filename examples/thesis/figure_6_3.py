"""Figure 6.3 of the thesis repeated: a glass in the five-fingered hand, and better or worse places for a finger.

    python examples/thesis/figure_6_3.py --finger ring --out out

The hand grasps the glass in the simulator, and its pose is estimated by touch. Each point of the glass is coloured by
the quality that the grasp would have with the finger there and the others unchanged: red is worse, grey equal, blue
better. Dots mark the points that the finger reaches (figure_6_3.html; as pictures figure_6_3.png, and
figure_6_3_unrolled.png with what the hand hides). The script prints the current quality, and the best one within reach.
It takes about twenty seconds.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 6.2.2.
"""

import dataclasses
import time
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, MeshcatParams
from rich.console import Console

import tactopose_drake as tp
from tactopose_drake.cli import DemoResult, run_demo
from tactopose_drake.core.grasping import ImprovementMap, improvement_map, reachable_points
from tactopose_drake.errors import UnknownNameError
from tactopose_drake.hand import load_hand_config, make_hand_reach
from tactopose_drake.station import load_scenario
from tactopose_drake.visualization import (
    aim_camera,
    draw_improvement,
    draw_scene,
    level_colours,
    save_html,
    save_picture,
    upright,
    vertex_levels,
)

FRICTION = 0.6


def grasp_glass(seed: int) -> DemoResult:
    """Simulates the grasp by a hand without errors, and estimates the pose from it."""
    scenario = load_scenario("shadow_like").without_errors()
    scenario.object, scenario.seed = "wine_glass", seed
    return run_demo(scenario)


def touching_fingers(result: DemoResult) -> list[str]:
    """The finger of each contact."""
    names: list[str] = result.grasp.station.diagram.GetOutputPort("fingers_in_contact").Eval(result.grasp.context)
    return names


def map_of(result: DemoResult, finger: str, points: int) -> ImprovementMap:
    """The quality after a finger has moved, at the estimated pose."""
    names, scene = touching_fingers(result), result.scene
    if finger not in names:
        raise UnknownNameError("finger", finger, names)
    return improvement_map(
        scene.model, scene.contacts, scene.estimate, names.index(finger), friction=FRICTION, points=points
    )


def reach_of(result: DemoResult, finger: str, found: ImprovementMap) -> NDArray[np.bool_]:
    """Which points of the glass a finger can reach past the others, shape (n,)."""
    station = result.grasp.station
    context = station.plant.GetMyContextFromRoot(result.grasp.context)
    config = load_hand_config(station.scenario.hand)
    reach = make_hand_reach(config, station.scenario.reach)
    centres, radii = [reach.palm_spheres[0]], [reach.palm_spheres[1]]
    for name, other in reach.fingers.items():
        if name != finger:
            joints = [station.plant.GetJointByName(j, station.hand.model_instance) for j in config.finger(name).joints]
            q = np.array([[joint.get_angle(context) for joint in joints]])
            centres += [other.geometry.spheres(q)[0], other.geometry.tip(q)]
            radii += [other.geometry.radius, np.array([other.geometry.tip_radius])]
    others = tp.HandGeometry(np.concatenate(centres), np.concatenate(radii))
    model, X_PO, generator = result.scene.model, result.scene.estimate, np.random.default_rng(0)
    return reachable_points(reach.fingers[finger], model, X_PO, found.p_OQ, found.n_OQ, generator, others=others)


def summary(finger: str, found: ImprovementMap, reachable: NDArray[np.bool_], seconds: float) -> str:
    """The numbers in a few sentences."""
    better = found.radius > found.current
    lines = [
        f"Radius as it is: {found.current:.4f} N. A move of the {finger} finger improves it at {better.mean():.0%} of "
        f"{len(found.radius)} points, to {found.radius.max():.4f} N at the best; at {np.mean(found.radius == 0):.0%} "
        f"the grasp would be lost. The map took {seconds:.1f} s.",
        f"The finger reaches {reachable.sum()} of the points.",
    ]
    if reachable.any():
        row = int(np.where(reachable, found.radius, -1.0).argmax())
        x, y, z = 1e3 * found.p_OQ[row]
        lines.append(
            f"Best of these: {found.radius[row]:.4f} N, {np.hypot(x, y):.0f} mm from the glass' axis, {z:.0f} mm up."
        )
    return "\n".join(lines)


def draw(result: DemoResult, found: ImprovementMap, reachable: NDArray[np.bool_]) -> Meshcat:
    """Draws the hand with the coloured glass."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    draw_scene(meshcat, dataclasses.replace(result.scene, hypotheses=(), prior=None, truth=None))
    draw_improvement(meshcat, "/tactopose/map", result.scene.model, found, reachable)
    meshcat.SetTransform("/tactopose/map", result.scene.estimate)
    aim_camera(meshcat, result.scene, upright(result.scene))
    return meshcat


def plot(finger: str, found: ImprovementMap, reachable: NDArray[np.bool_], path: Path) -> None:
    """Plots the unrolled glass, the outside and inside separately: points by angle about the axis and by height."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    x, y, z = 1e3 * found.p_OQ.T
    outside = found.n_OQ[:, 0] * x + found.n_OQ[:, 1] * y >= 0.0
    for column, (side, title) in enumerate(((outside, "outside"), (~outside, "inside"))):
        axis = figure.add_subplot(1, 2, column + 1)
        angle = np.degrees(np.arctan2(y, x))
        axis.scatter(angle[side], z[side], c=level_colours(found.level)[side], s=18)
        marked = side & reachable
        axis.scatter(
            angle[marked], z[marked], facecolors="none", edgecolors="k", s=30, label=f"{finger} finger reaches"
        )
        axis.set(title=f"{title}: red worse, blue better", xlabel="angle about the axis, deg", ylabel="height, mm")
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower right")
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--finger", default="ring", show_default=True, help="The finger that moves.")
@click.option("--points", type=click.IntRange(min=10), default=1000, show_default=True, help="Points on the glass.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the grasp.")
@click.option("--out", type=click.Path(path_type=Path), help="Writes the scene and the plot here.")
def main(finger: str, points: int, seed: int, out: Path | None) -> None:
    """Grasps a glass in the simulator and shows better places for a finger."""
    result = grasp_glass(seed)
    started = time.perf_counter()
    found = map_of(result, finger, points)
    seconds = time.perf_counter() - started
    reachable = reach_of(result, finger, found)
    Console().print(summary(finger, found, reachable, seconds), highlight=False)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        save_html(out / "figure_6_3.html", draw(result, found, reachable))
        save_picture(
            out / "figure_6_3.png",
            dataclasses.replace(result.scene, prior=None, truth=None),
            captions=("", f"the {finger} finger elsewhere: red worse, blue better"),
            colours=level_colours(vertex_levels(result.scene.model, found)),
        )
        plot(finger, found, reachable, out / "figure_6_3_unrolled.png")


if __name__ == "__main__":
    main()
