"""Hand over and place: a pencil is put into the closing hand, felt, and stuck into a hole of 15 mm radius in a box.

python examples/hand_over_and_place.py --seeds 100 --out out/hand_over
python examples/hand_over_and_place.py --first-seed 0 --scene --out out/hand_over

After section 4.3.2.3 of [B16]. The pencil is handed over anyhow: turned by up to 10 degrees about each axis and shifted
by up to 5 mm along each from where the hand expects it, slid by up to 20 mm along itself, either end up, at any spin.
Whoever hands it over holds on while the hand closes on it and feels where it lies. Mostly that is not where the hand
holds it well: the hand opens, the arm brings it to where the pencil lies in the middle of the grip, and it closes once
more. Once the pencil lies well and all five fingers carry their share, it is let go. A first touch that tells too
little for that is made once more, with the pencil offered elsewhere.
There is no vision and no prior: its pose comes from the five fingertips' forces alone. They tell the line that the
pencil lies on. They do not tell its slide, its spin, and hardly which end is up, and the task does not ask for those:
the hole takes either end, and the arm starts high and stops low enough for any slide that the hand-over allows.

All of it is simulated with hydroelastic contact: the closing of the fingers, the way of the arm, the insertion, the
release. A trial succeeds if the pencil then stands in the box, through the hole.

[B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import argparse
import csv
import dataclasses
import math
import shutil
import time
from multiprocessing import get_context
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from pydrake.common.schema import Transform
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort
from rich.console import Console
from rich.progress import track
from rich.table import Table

import tactopose_drake as tp
from tactopose_drake.arms.place_planning import PlaceParams, PlacePlanner
from tactopose_drake.arms.station import ArmParts, ArmSetup, ArmStation, SceneModel, make_arm_station
from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.core.grasping.grasp_planner import GraspPlan, PlannerParams, plan_grasps
from tactopose_drake.core.held_axis import HeldAxis
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.grasping.hand_reach import make_hand_reach
from tactopose_drake.hand import load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.scenario import Scenario
from tactopose_drake.station_grasp import planned_pose
from tactopose_drake.systems.place_task import PlaceTask
from tactopose_drake.systems.random_sources import seed_random_sources
from tactopose_drake.visualization import save_html, set_stage

DOWN_P = np.array(PlaceParams().down_P)
HOLE_RADIUS, RIM = 0.015, 0.1  # m; the rim's height above the table
TURN, SHIFT, SLIDE = math.radians(10.0), 0.005, 0.020  # of the hand-over, either way
# The hand closes as it would on this bar, on beyond its surface and with more force: whatever it meets stops it.
BAR_RADIUS, BEYOND, FIRMNESS = 0.006, 8.0, 1.5  # m, N of push, share of the planned force
LONGEST, REST = 25.0, 0.6  # simulated time at the most, and after the hand has opened, s


@dataclasses.dataclass
class Trial:
    """How one hand-over went: errors are of the touch, when the arm set off."""

    seed: int
    success: bool = False
    tries: int = 1  # until the hand had a firm grip
    met: int = 0  # how often the arm brought the hand to the pencil
    outcome: str = ""
    angle_deg: float = math.nan  # between the pencil's axis as felt and in truth
    end_mm: float = math.nan  # how far the pencil's lower end is from where it is felt, across the pencil
    sigma_mm: float = math.nan  # its standard deviation as stated
    upside_down: float = math.nan  # probability that the hypotheses give to the wrong end up
    # In truth, from when it was let go until the task failed or the hand was to open: how far the pencil turned in the
    # hand, and how far its lower end moved.
    turned_deg: float = math.nan
    moved_mm: float = math.nan
    hole_mm: float = math.nan  # distance of the pencil's axis from the hole's in the rim's plane, before the release
    simulated: float = 0.0  # s
    cpu: float = 0.0  # s


def plan_closing() -> GraspPlan:
    """How the hand closes: on any pencil alike, across its palm, with all five fingers.

    The outer fingers press from the palm's side, the two between them from the front, and the thumb presses the bar
    into the groove that they are: with hardly any friction the five forces balance. A grip whose balance needs friction
    holds at first; then the pencil creeps, turns, and springs out.
    """
    bar = trimesh.creation.cylinder(radius=BAR_RADIUS, height=0.175, sections=64)
    bar.apply_translation([0.0, 0.0, 0.0875])
    # Off the joints' limits: a finger that meets the pencil later than planned is to go on closing.
    reach = make_hand_reach(load_hand_config("shadow_like"), ReachParams(lift=0.02, limit_margin=0.12))
    params = PlannerParams(
        grasps=3, least_fingers=5, tilt_deg=10.0, normal_force=2.0, least_force=1.0, friction=0.15
    )  # fmt: skip
    thumb_up = np.array([-0.05, 0.0, 0.0])  # the weight, N, in P
    model = tp.ObjectModel.from_mesh(bar, mass=0.0055)
    plan = plan_grasps(model, reach, thumb_up, params, np.random.default_rng(6))[0]
    fingers = {}
    for name, part in plan.fingers.items():
        motion = part.motion
        q_touch = motion.q_touch + BEYOND * motion.closing
        motion = dataclasses.replace(motion, q_touch=q_touch, set_force=FIRMNESS * motion.set_force)
        fingers[name] = dataclasses.replace(part, motion=motion)
    return dataclasses.replace(plan, fingers=fingers)


def best_grip(closing: GraspPlan) -> HeldAxis:
    """The axis of the bar that the hand is made to close on, from the middle of its touches towards the lower end."""
    p_PG = np.mean([part.p_PC for part in closing.fingers.values()], axis=0)
    direction, p_PB = -closing.X_PO[:, 2], closing.X_PO[:, 3]
    return HeldAxis(p_PB + ((p_PG - p_PB) @ direction) * direction, direction, 0.0)


def hand_over(plan: GraspPlan, generator: np.random.Generator) -> GraspPlan:
    """The same closing, with a pencil that is held into it anyhow."""
    axis, p_PB = plan.X_PO[:, 2], plan.X_PO[:, 3]
    grip = np.mean([part.p_PC for part in plan.fingers.values()], axis=0)
    middle = p_PB + ((grip - p_PB) @ axis) * axis + generator.uniform(-SHIFT, SHIFT, 3)
    spin = exp_so3(np.array([0.0, 0.0, generator.uniform(-math.pi, math.pi)]))
    R_PO = exp_so3(generator.uniform(-TURN, TURN, 3)) @ plan.X_PO[:, :3] @ spin
    if generator.random() < 0.5:
        R_PO = R_PO @ np.diag([1.0, -1.0, -1.0])
    height = 0.0875 + generator.uniform(-SLIDE, SLIDE)
    return dataclasses.replace(plan, X_PO=np.column_stack([R_PO, middle - height * R_PO[:, 2]]))


def write_collision_pencil(folder: Path) -> Path:
    """The package's pencil for the simulator, with long triangles between its edges instead of short ones.

    Their surfaces are 0.02 mm apart where the hand holds it, and 0.3 mm where the sharpening begins; the contact
    problems get half as large.
    """
    folder.mkdir(parents=True, exist_ok=True)
    vertices = trimesh.load_mesh(model_path("objects", "pencil.obj")).vertices
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])
    # Three points round each of the six edges, 5 degrees apart; the rest of the ring lies between them on flats.
    on_edge = np.abs(np.mod(angle + math.pi / 6, math.pi / 3) - math.pi / 6) < math.radians(6.0)
    rings = np.array([0.0, 0.0006, 0.149, 0.15139, 0.15378, 0.15617, 0.15936, 0.16255, 0.1745, 0.175])
    on_ring = np.abs(vertices[:, 2:] - rings).min(axis=1) < 3e-5
    trimesh.PointCloud(vertices[on_edge & on_ring]).convex_hull.export(folder / "pencil.obj")
    return Path(shutil.copy(model_path("objects", "pencil.sdf"), folder / "pencil.sdf"))


def make_trial_station(
    closing: GraspPlan, pencil: Path, meshcat: Meshcat | None = None
) -> tuple[ArmStation, PlacePlanner]:
    """The whole diagram: sensing, estimate, decision, control; shown by Meshcat, if there is one."""
    scenario = Scenario(object=str(pencil))
    scenario.controller.closing_time = 1.6
    # All of a pencil is within two millimetres of an edge, where the normal says little.
    scenario.estimation.contacts.sigma_position = 0.0006
    scenario.estimation.contacts.sigma_normal_deg = 8.0
    place = PlaceParams(most_slide=SLIDE)
    scenes = "package://tactopose_drake/models/scenes"
    box = Transform(translation=[*place.p_WHole[:2], 0.0])
    setup = ArmSetup(scene=[SceneModel(model=f"{scenes}/table.sdf"), SceneModel(model=f"{scenes}/hole_box.sdf")])
    setup.scene[1].X_WModel = box
    planners = []

    def add_decision(builder: DiagramBuilder, parts: ArmParts) -> OutputPort:
        X_FBase = setup.X_FBase.GetDeterministicValue()
        planner = PlacePlanner(
            parts.arm_plant, parts.arm_alone, parts.hand.config, X_FBase, parts.model, best_grip(closing), place
        )  # fmt: skip
        task = builder.AddNamedSystem("place_task", PlaceTask(planner, np.array(setup.q_start)))
        grasp = builder.GetSubsystemByName("grasp_controller")
        builder.Connect(grasp.GetOutputPort("holding"), task.GetInputPort("holding"))
        builder.Connect(grasp.GetOutputPort("status"), task.GetInputPort("grasp_status"))
        builder.Connect(task.GetOutputPort("open"), grasp.GetInputPort("open"))
        for name in ("contacts", "hypotheses"):
            builder.Connect(parts.estimation.GetOutputPort(name), task.GetInputPort(name))
        builder.Connect(parts.senses["joint_positions"], task.GetInputPort("joint_positions"))
        builder.ExportOutput(task.GetOutputPort("phase"), "phase")
        planners.append(planner)
        return task.GetOutputPort("arm_reference")

    model = tp.ObjectModel.from_mesh(model_path("objects", "pencil.obj"), mass=0.0055)
    return make_arm_station(scenario, closing, setup, add_decision, model=model, meshcat=meshcat), planners[0]


def run_trial(
    closing: GraspPlan, station: ArmStation, planner: PlacePlanner, seed: int, longest: float = LONGEST
) -> Trial:
    """One trial from the hand-over to the end."""
    started, trial = time.process_time(), Trial(seed)
    generator = np.random.default_rng(seed)
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    seed_random_sources(station.diagram, context, seed)
    _offer(station, context, hand_over(closing, generator))
    phase, ends_at, let_go = "receive", longest, None
    while context.get_time() < ends_at - 1e-9:
        simulator.AdvanceTo(context.get_time() + 0.02)
        before, phase = phase, station.diagram.GetOutputPort("phase").Eval(context)
        if phase == before:
            continue
        if phase == "receive":
            trial.tries += 1
        if phase == "receive" and before == "again":
            _offer(station, context, hand_over(closing, generator))
        elif phase == "meet":
            trial.met += 1
        elif phase == "feel":
            station.object_joint.Unlock(station.plant.GetMyMutableContextFromRoot(context))
            let_go = _lower_half(station, context)
        elif phase == "move":
            _note_touch(trial, station, planner, context)
        elif phase == "release":
            trial.hole_mm = 1e3 * float(np.linalg.norm(_at_rim(station, context) - planner_hole()))
        if let_go is not None and (phase == "release" or phase.startswith("failed")):
            _note_motion(trial, let_go, _lower_half(station, context))
        if phase == "retreat" or phase.startswith("failed"):
            ends_at = context.get_time() + REST
    trial.success, trial.outcome = _judge(station, context, phase, trial)
    trial.simulated, trial.cpu = context.get_time(), time.process_time() - started
    return trial


def _offer(station: ArmStation, context: Context, plan: GraspPlan) -> None:
    """Holds the pencil into the open hand."""
    plant_context = station.plant.GetMyMutableContextFromRoot(context)
    X_WP = station.hand.palm_frame.CalcPoseInWorld(plant_context)
    station.plant.SetFreeBodyPose(plant_context, station.object_body, X_WP @ planned_pose(plan))


def planner_hole() -> np.ndarray:
    """The hole's middle in the world, x and y, m."""
    return np.array(PlaceParams().p_WHole[:2])


def _note_touch(trial: Trial, station: ArmStation, planner: PlacePlanner, context: Context) -> None:
    """The touch's errors in the palm."""
    task = station.diagram.GetSubsystemByName("place_task")
    held = task.state(task.GetMyContextFromRoot(context)).held
    X_PO = station.object_pose(context)
    axis = X_PO.rotation().col(2) * math.copysign(1.0, X_PO.rotation().col(2) @ held.direction)
    trial.angle_deg = math.degrees(math.acos(min(1.0, float(axis @ held.direction))))
    end = held.point(planner.longest_end) - X_PO.translation()
    trial.end_mm = 1e3 * float(np.linalg.norm(end - (end @ axis) * axis))
    trial.sigma_mm = 1e3 * held.sigma
    estimate = station.diagram.GetOutputPort("hypotheses").Eval(context)
    trial.upside_down = sum(
        hypothesis.probability
        for hypothesis in estimate.hypotheses
        if hypothesis.X_PO.rotation().col(2) @ X_PO.rotation().col(2) < 0.0
    )


def _lower_half(station: ArmStation, context: Context) -> np.ndarray:
    """The pencil's middle and lower end in the palm, shape (2, 3), m."""
    X_PO = station.object_pose(context)
    points = np.array([X_PO.multiply(np.array([0.0, 0.0, z])) for z in (0.0875, 0.0, 0.175)])
    return points[[0, 1 + int(points[2] @ DOWN_P > points[1] @ DOWN_P)]]


def _note_motion(trial: Trial, before: np.ndarray, after: np.ndarray) -> None:
    """How the pencil has moved in the hand."""
    (a, b), lengths = (half[1] - half[0] for half in (before, after)), 0.0875**2
    trial.turned_deg = math.degrees(math.acos(max(-1.0, min(1.0, float(a @ b) / lengths))))
    trial.moved_mm = 1e3 * float(np.linalg.norm(after[1] - before[1]))


def _ends(station: ArmStation, context: Context) -> np.ndarray:
    """The pencil's ends in the world, the lower one first, shape (2, 3), m."""
    X_WO = station.object_body.EvalPoseInWorld(station.plant.GetMyContextFromRoot(context))
    ends = np.array([X_WO.multiply(np.array([0.0, 0.0, z])) for z in (0.0, 0.175)])
    return ends[np.argsort(ends[:, 2])]


def _at_rim(station: ArmStation, context: Context) -> np.ndarray:
    """Where the pencil's axis crosses the rim's plane, x and y, m."""
    low, high = _ends(station, context)
    share = (RIM - low[2]) / (high[2] - low[2])
    return low[:2] + share * (high - low)[:2]


def _judge(station: ArmStation, context: Context, phase: str, trial: Trial) -> tuple[bool, str]:
    """Whether the pencil stands in the box through the hole, and what is wrong else."""
    low, high = _ends(station, context)
    inside = low[2] < RIM - 0.03 < RIM < high[2] and np.abs(low[:2] - planner_hole()).max() < 0.06
    if inside and np.linalg.norm(_at_rim(station, context) - planner_hole()) < HOLE_RADIUS:
        return True, "in the hole"
    if phase.startswith("failed"):
        return False, phase.removeprefix("failed: ")
    if phase in ("receive", "again", "feel", "move", "insert", "release"):
        return False, f"not finished: {phase}"
    if trial.hole_mm > 1e3 * HOLE_RADIUS:
        return False, f"pose wrong: {trial.hole_mm:.0f} mm beside the hole's axis at the rim"
    held = station.diagram.GetOutputPort("contacts").Eval(context)
    return False, "the pencil stuck to the fingers" if len(held) else "the pencil met the rim or left the hole again"


def save_plot(trials: list[Trial], path: Path) -> None:
    """Errors of the touch, and where the pencils met the hole."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for good, colour, label in ((True, "tab:green", "in the hole"), (False, "tab:red", "failed")):
        chosen = [trial for trial in trials if trial.success == good]
        left.scatter([t.angle_deg for t in chosen], [t.end_mm for t in chosen], color=colour, label=label)
        right.scatter([t.sigma_mm for t in chosen], [t.hole_mm for t in chosen], color=colour, label=label)
    left.axhline(15.0, color="grey", linestyle="--")
    left.axvline(15.0, color="grey", linestyle="--", label="thesis: 15 mm or 15° jeopardise the task")
    left.set(xlabel="angle error of the axis, °", ylabel="error of the lower end, mm", title="touch against truth")
    right.axhline(1e3 * HOLE_RADIUS - 4.0, color="grey", linestyle="--", label="what the hole leaves")
    right.set(
        xlabel="stated standard deviation of the lower end, mm",
        ylabel="pencil's axis from the hole's at the rim, mm",
        title="at the hole, before the release",
    )
    for axes in (left, right):
        axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


_of_process: list[tuple[GraspPlan, ArmStation, PlacePlanner]] = []


def _begin_process(closing: GraspPlan, pencil: Path) -> None:
    """Builds the station that all trials of a process use."""
    _of_process.append((closing, *make_trial_station(closing, pencil)))


def _run_in_process(seed: int) -> Trial:
    return run_trial(*_of_process[0], seed)


def save_scene(closing: GraspPlan, pencil: Path, seed: int, path: Path, longest: float = LONGEST) -> Trial:
    """One trial, and a page that replays it in any browser."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    station, planner = make_trial_station(closing, pencil, meshcat)
    set_stage(meshcat, np.array([0.5, -0.1, 0.4]), 1.3, np.array([0.3, -1.0, 0.35]))
    meshcat.StartRecording()
    trial = run_trial(closing, station, planner, seed, longest)
    meshcat.PublishRecording()
    save_html(path, meshcat)
    return trial


def main() -> None:
    """Runs the trials and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/hand_over"))
    parser.add_argument("--scene", action="store_true", help="replay the first trial in scene.html, and do no other")
    arguments = parser.parse_args()
    setting = (plan_closing(), write_collision_pencil(arguments.out / "model"))
    if arguments.scene:
        print_table([save_scene(*setting, arguments.first_seed, arguments.out / "scene.html")])
        return
    seeds, trials = range(arguments.first_seed, arguments.first_seed + arguments.seeds), []
    with (arguments.out / "trials.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in dataclasses.fields(Trial)])
        writer.writeheader()
        # What a trial takes of memory is not all given back: processes end after some.
        with get_context("spawn").Pool(arguments.jobs, _begin_process, setting, maxtasksperchild=10) as pool:
            for trial in track(pool.imap(_run_in_process, seeds), total=len(seeds), description="trials"):
                trials.append(trial)
                writer.writerow(dataclasses.asdict(trial))
                file.flush()
    save_plot(trials, arguments.out / "figures_4_17_and_4_18.png")
    print_table(trials)


def print_table(trials: list[Trial]) -> None:
    """The summary, and every failure."""
    table = Table(title=f"{sum(t.success for t in trials)} of {len(trials)} pencils in the hole")
    for heading in ("", "median", "95 %", "largest"):
        table.add_column(heading)
    for name, label in (
        ("angle_deg", "axis by touch, °"),
        ("end_mm", "lower end by touch, mm"),
        ("sigma_mm", "its stated standard deviation, mm"),
        ("upside_down", "probability of the wrong end up"),
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


def explain(trial: Trial) -> str:
    """What the task says of a failure, and what the simulator knows of it."""
    if math.isnan(trial.turned_deg):
        return f"{trial.outcome}; the pencil was not let go"
    touch = "the arm did not set off"
    if not math.isnan(trial.end_mm):
        touch = (
            f"touch was {trial.end_mm:.1f} mm off at the lower end when the arm set off ({trial.sigma_mm:.1f} stated)"
        )
    return (
        f"{trial.outcome}; {touch}; since the pencil was let go, it turned by {trial.turned_deg:.0f}° in the hand and "
        f"its lower end moved by {trial.moved_mm:.0f} mm"
    )


if __name__ == "__main__":
    main()
