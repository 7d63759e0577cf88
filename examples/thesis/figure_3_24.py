"""Figure 3.24 of the thesis: vision of a held object that an arm carries, alone and corrected by touch.

    python examples/thesis/figure_3_24.py --out out/figure_3_24

A hand holds the soda can, then the tea box, and the arm moves it to four places. A depth camera, Drake's `RgbdSensor`
with the noise of a Kinect, looks from the side and above. A tracker finds the object in its images, and fits the
object's model ten times a second to the pixels that the hand does not occlude. This is done twice: with a tracker that
excludes the pixels of arm, hand and table, and with one that, as in [B16], cannot distinguish them from the object's
("the vision not being able to segment the object from the robot body"). The belief receives the tracker's poses, each
with the covariance that the tracker states, and the fingertips' contacts a hundred times a second.

The error is the distance of the object's base centre from the truth while the arm rests at a place, as [B16] measured
it (section 3.3.2.3: 85.8 mm of vision, 26.6 mm corrected with the can; 80.2 mm and 20.0 mm with the tea box). Poses of
the box that differ by one of its symmetries count as equal.

[B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import argparse
import dataclasses
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from carrying_route import Route, plan_route
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, OutputPort

import tactopose_drake as tp
from tactopose_drake.core.poses import compose, rotation_angles
from tactopose_drake.core.vision import DepthCameraModel
from tactopose_drake.station import (
    ArmParts,
    ArmSetup,
    ArmStation,
    Scenario,
    SceneModel,
    make_arm_station,
    plan_scenario,
)
from tactopose_drake.systems import (
    AddDepthCamera,
    CameraView,
    DepthTracker,
    DepthTrackerParams,
    PoseTrackingParams,
)

Array = NDArray[np.float64]

OBJECTS = {"soda_can": (85.8, 26.6), "tea_box": (80.2, 20.0)}  # mm, [B16]: vision, corrected
TRACKERS = {"leaves out the hand": True, "takes the hand for the object": False}  # whether it excludes the hand
# Positions of the palm in the world, m; the thumb stays up.
PLACES = np.array([[0.75, -0.25, 0.35], [0.85, 0.05, 0.45], [0.75, 0.30, 0.40], [0.85, 0.00, 0.60]])
CAMERA, LOOKS_AT = np.array([0.6, -0.6, 1.3]), np.array([0.85, 0.0, 0.5])  # m, in the world
SETTLE = 0.3  # time at the beginning of each rest during which the error is not counted, s


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """Base centres in the world while the object is carried, shape (n, 3) each, m; NaN if there is no pose."""

    time: Array
    truth: Array
    vision: Array
    corrected: Array
    status: list[str]
    hidden: Array
    at_place: NDArray[np.bool_]
    duration: float

    def errors(self, positions: Array) -> Array:
        """Distances from the truth at the places, mm, without the instants that have no pose."""
        distance = 1e3 * np.linalg.norm(positions - self.truth, axis=1)[self.at_place]
        kept: Array = distance[np.isfinite(distance)]
        return kept


def camera_pose() -> RigidTransform:
    """X_WC: z points towards the target, y down."""
    forward = (LOOKS_AT - CAMERA) / np.linalg.norm(LOOKS_AT - CAMERA)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return RigidTransform(RotationMatrix(np.column_stack([right, np.cross(forward, right), forward])), CAMERA)


def scene_instances(parts: ArmParts) -> list[ModelInstanceIndex]:
    """The instances that the tracker knows as scene: all models except arm, hand and object."""
    known = {parts.arm.model_instance, parts.hand.model_instance, parts.object_body.model_instance()}
    others = map(ModelInstanceIndex, range(2, parts.plant.num_model_instances()))
    return [instance for instance in others if instance not in known]


def make_carrying_station(name: str, knows_hand: bool, seed: int, places: Array) -> tuple[ArmStation, Route]:
    """A station with arm, hand, tracker and belief; the hand will hold the object."""
    tracking = PoseTrackingParams(use_uncertainty=False)  # the hand has no errors, as in the thesis
    tracking.contacts.sigma_position, tracking.contacts.sigma_normal_deg = 0.0005, 3.0
    scenario = Scenario(object=name, seed=seed, tracking=tracking)
    model = scenario.object_model()
    setup = ArmSetup(scene=[SceneModel(model="package://tactopose_drake/models/scenes/table.sdf")])
    routes = []

    def add_decision(builder: DiagramBuilder, parts: ArmParts) -> OutputPort:
        # Half the resolution of a Kinect.
        params = DepthTrackerParams(latency=0.1, camera=DepthCameraModel(width=320, height=240, focal_length=288.0))
        params.model.knows_hand = knows_hand
        tracker = DepthTracker(
            CameraView(
                plant=parts.plant,
                inspector=parts.scene_graph.model_inspector(),
                object_body=parts.object_body,
                object_model=model,
                palm_frame=parts.hand.palm_frame,
                X_WC=camera_pose(),
            ),
            others=(parts.arm.model_instance, *scene_instances(parts)),
            params=params,
        )
        builder.AddNamedSystem("depth_tracker", tracker)
        image = AddDepthCamera(builder, parts.scene_graph, camera_pose(), params.camera)
        builder.Connect(image, tracker.GetInputPort("depth_image"))
        builder.Connect(parts.plant.get_body_poses_output_port(), tracker.GetInputPort("body_poses"))
        builder.Connect(tracker.GetOutputPort("vision"), parts.estimation.GetInputPort("vision"))
        for port in ("vision", "pose_in_world", "hidden_share"):
            builder.ExportOutput(tracker.GetOutputPort(port), port)
        route = builder.AddNamedSystem("route", Route(plan_route(parts, setup, places)))
        holding = builder.GetSubsystemByName("grasp_controller").GetOutputPort("holding")
        builder.Connect(holding, route.GetInputPort("holding"))
        builder.ExportOutput(route.GetOutputPort("rested"), "rested")
        routes.append(route)
        return route.GetOutputPort("arm_reference")

    plan = plan_scenario(scenario, model)[0]
    return make_arm_station(scenario, plan, setup, add_decision, model=model), routes[0]


def carry(name: str, *, knows_hand: bool = True, seed: int = 0, places: Array = PLACES) -> Track:
    """Simulates one object from the grasp to the last place."""
    started = time.process_time()
    station, route = make_carrying_station(name, knows_hand, seed, places)
    simulator = Simulator(station.diagram)
    context = simulator.get_mutable_context()
    station.start(context)
    simulator.set_monitor(station.release_when_held)
    rows, status, end = [], [], 4.0

    def get(port: str) -> object:
        return station.diagram.GetOutputPort(port).Eval(context)

    begun = False
    while context.get_time() < end - 1e-9:
        simulator.AdvanceTo(context.get_time() + 0.05)
        if not get("holding")[0]:
            continue
        if not begun:
            begun, end = True, context.get_time() + 0.5 + route.duration
        truth = station.object_body.EvalPoseInWorld(station.plant.GetMyContextFromRoot(context))
        vision = _base(get("pose_in_world"), truth, station.model)
        status.append(str(get("status")))
        known = status[-1].split(":")[0] in ("ok", "ambiguous", "slipping")
        corrected = _base(get("object_pose_in_world") if known else None, truth, station.model)
        where = (*truth.translation(), *vision, *corrected)
        rows.append([context.get_time(), get("rested")[0], get("hidden_share")[0], *where])
    table = np.array(rows)
    return Track(
        table[:, 0], table[:, 3:6], table[:, 6:9], table[:, 9:12], status, table[:, 2], table[:, 1] > SETTLE,
        time.process_time() - started,
    )  # fmt: skip


def _base(X_WO: RigidTransform | None, truth: RigidTransform, model: tp.ObjectModel) -> Array:
    """The base centre of the symmetric pose that is nearest to the truth; NaN without a pose."""
    if X_WO is None:
        return np.full(3, np.nan)
    alike = compose(X_WO.GetAsMatrix34()[None], model.symmetry_poses)
    base: Array = alike[np.argmin(rotation_angles(alike[:, :, :3], truth.rotation().matrix())), :, 3]
    return base


def save_plot(tracks: dict[tuple[str, str], Track], path: Path) -> None:
    """Plots x and y of the base centre as in the figure: a row for each object, a column for each tracker."""
    names = list(dict.fromkeys(name for name, _ in tracks))
    figure, axes = plt.subplots(
        len(names), len(TRACKERS), figsize=(12, 1 + 3.5 * len(names)), layout="constrained", squeeze=False
    )
    for (name, tracker), track in tracks.items():
        axis = axes[names.index(name), list(TRACKERS).index(tracker)]
        for i, (letter, colour, dots) in enumerate((("x", "#0072b2", "#56b4e9"), ("y", "#d55e00", "#e69f00"))):
            axis.plot(track.time, track.vision[:, i], "o", fillstyle="none", color=colour, label=f"{letter}, vision")
            axis.plot(track.time, track.corrected[:, i], color=colour, label=f"{letter}, corrected")
            place = track.at_place
            axis.plot(track.time[place], track.truth[place, i], ".", color=dots, markersize=3, label=f"{letter}, truth")
        axis.set(title=f"{name}; the tracker {tracker}", xlabel="time, s", ylabel="base centre in the world, m")
    axes[0, 0].legend(fontsize="small")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def markdown(tracks: dict[tuple[str, str], Track], places: int, seed: int) -> str:
    """The errors and the thesis' errors as Markdown."""
    lines = [
        f"# Figure 3.24, places: {places}, seed {seed}",
        "",
        "Error of the base centre while the arm rests, mm: the mean, in brackets the largest; the thesis' are of its "
        "own hand, camera and objects.",
        "",
        "| object | the tracker | hidden, % | vision | corrected | thesis: vision | corrected | CPU time, s |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for (name, tracker), track in tracks.items():
        errors = [track.errors(positions) for positions in (track.vision, track.corrected)]
        cells = [f"{e.mean():.1f} ({e.max():.1f})" if len(e) else "no pose" for e in errors]
        hidden = f"{100 * track.hidden.min():.0f} to {100 * track.hidden.max():.0f}"
        thesis = [f"{value:.1f}" for value in OBJECTS[name]]
        lines.append("| " + " | ".join([name, tracker, hidden, *cells, *thesis, f"{track.duration:.0f}"]) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Carries both objects with both trackers, prints the errors, and saves the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", choices=OBJECTS, default=list(OBJECTS))
    parser.add_argument("--places", type=int, choices=range(1, len(PLACES) + 1), default=len(PLACES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/figure_3_24"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    tracks = {
        (name, tracker): carry(name, knows_hand=knows, seed=arguments.seed, places=PLACES[: arguments.places])
        for name in arguments.objects
        for tracker, knows in TRACKERS.items()
    }
    text = markdown(tracks, arguments.places, arguments.seed)
    print(text)
    (arguments.out / "figure_3_24.md").write_text(text, encoding="utf-8")
    save_plot(tracks, arguments.out / "figure_3_24.png")


if __name__ == "__main__":
    main()
