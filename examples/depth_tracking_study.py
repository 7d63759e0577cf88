"""Depth camera tracking, alone and corrected by touch, in simulated grasps of several objects.

python examples/depth_tracking_study.py --grasps 20 --first-seed 100

Drake's `RgbdSensor` looks at hand and object, with a Kinect's noise. A tracker finds the object in the whole image
while the hand is open, and follows it while the fingers close; it knows only the object's mesh. Two trackers use the
same images: one masks the hand's pixels, as rendered from the joint positions; the other, as in [B16], cannot
distinguish them from the object's ("the vision not being able to segment the object from the robot body"). At the end
of each grasp, each tracker's last pose and covariance are the prior of an estimate from the fingertips' contacts; a
third estimate has no prior, and neither has that of a tracker that has lost the object.

The error of a pose is the distance of the object's base centre from the truth, as measured in [B16] (section 3.3.2.3),
and the rotation angle, both for the nearest of the poses that look the same. A tracker's covariance is right if the
truth is in its 95 % ellipsoid; that of a touch, if the truth is in the set of hypotheses with 95 % of the probability.

[B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016.
"""

import argparse
import dataclasses
import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from calibration import region_holds
from depth_tracking_summary import LEAVES_OUT, NOTHING, TAKES, Outcome, markdown, save_plot
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from rich.console import Console
from rich.progress import track

import tactopose_drake as tp
from tactopose_drake.core.poses import compose, increments_between
from tactopose_drake.core.shape import turn_toward
from tactopose_drake.resources import fixed_pose
from tactopose_drake.runs import GraspResult, RunView, run_grasp
from tactopose_drake.station import Scenario, Station, load_scenario, make_station, plan_scenario
from tactopose_drake.systems import CameraView, DepthTracker

Array = NDArray[np.float64]

OBJECTS = ("soda_can", "tea_box", "mug", "spray_bottle")
PERIODS = {LEAVES_OUT: 0.2, TAKES: 1.0}  # periods of the trackers, s


class SecondTracker:
    """A second tracker with the images of the station's own, which cannot distinguish the hand from the object."""

    def __init__(self, station: Station) -> None:
        params = dataclasses.replace(
            station.scenario.vision,
            period=PERIODS[TAKES],
            model=dataclasses.replace(station.scenario.vision.model, knows_hand=False),
        )
        self._tracker = DepthTracker(view_of(station), params=params)
        self._simulator = Simulator(self._tracker)
        context = self._simulator.get_mutable_context()
        self._tracker.GetInputPort("noise").FixValue(context, np.zeros(8))

    def see(self, station: Station, context: Context) -> None:
        """Processes the image of this time."""
        first, own = station.diagram.GetSubsystemByName("vision"), self._simulator.get_mutable_context()
        for name in ("depth_image", "body_poses"):
            value = first.GetInputPort(name).Eval(first.GetMyContextFromRoot(context))
            self._tracker.GetInputPort(name).FixValue(own, AbstractValue.Make(value))
        self._simulator.AdvanceTo(context.get_time() + 1e-6)

    def vision(self) -> tuple[tp.PoseMeasurement | None, float]:
        """The tracker's pose, and the share of the object that it believes hidden."""
        context = self._simulator.get_context()
        hidden = self._tracker.GetOutputPort("hidden_share").Eval(context)[0]
        return self._tracker.GetOutputPort("vision").Eval(context), float(hidden)


def view_of(station: Station) -> CameraView:
    """The view of the station's camera."""
    return CameraView(
        plant=station.plant,
        inspector=station.scene_graph.model_inspector(),
        object_body=station.object_body,
        object_model=station.model,
        palm_frame=station.hand.palm_frame,
        X_WC=fixed_pose("Scenario.X_WC", station.scenario.X_WC),
    )


def make_scenario(name: str, seed: int) -> Scenario:
    """The shipped scenario with a depth camera, with a hand without errors, as in the thesis."""
    scenario = load_scenario("shadow_like_depth").without_errors()
    scenario.object, scenario.seed = name, seed
    scenario.vision.period = PERIODS[LEAVES_OUT]
    scenario.estimation.estimator.period = 2.0 * scenario.duration  # the estimates are made at the end
    return scenario


def alike(model: tp.ObjectModel, X_PO: Array, truth: Array) -> Array:
    """The nearest to the truth of the poses that look the same as `X_PO`, shape (3, 4)."""
    poses = turn_toward(compose(X_PO[None], model.symmetry_poses), truth, model.symmetries)
    increments = increments_between(truth, poses)
    nearest: Array = poses[np.argmin(np.linalg.norm(increments[:, :3], axis=1))]
    return nearest


def errors(model: tp.ObjectModel, X_PO: Array, truth: Array) -> tuple[float, float]:
    """Errors of a pose (3, 4): distance of the base centre, mm, and angle, deg."""
    increment = increments_between(truth, alike(model, X_PO, truth)[None])[0]
    return 1e3 * float(np.linalg.norm(increment[3:])), float(np.degrees(np.linalg.norm(increment[:3])))


def judge(grasp: GraspResult, vision: tp.PoseMeasurement | None, hidden: float) -> Outcome:
    """Compares a tracker's pose, and the estimate from touch with it as the prior, with the truth."""
    model, truth = grasp.station.model, grasp.X_PO.GetAsMatrix34()
    nothing = (np.nan, np.nan)
    seen, stated, squared, prior = nothing, nothing, np.nan, None
    if vision is not None:
        seen = errors(model, vision.X_PO, truth)
        guess = vision.as_prior()
        stated = 1e3 * guess.sigma_translation, float(np.degrees(guess.sigma_rotation))
        off = increments_between(alike(model, vision.X_PO, truth)[None], truth)[0]
        squared = float(off @ np.linalg.solve(vision.covariance, off))
        prior = tp.PosePrior(guess.mean, guess.sigma_translation, guess.sigma_rotation)
    contacts = grasp.station.diagram.GetOutputPort("contacts").Eval(grasp.context)
    plant_context = grasp.station.plant.GetMyContextFromRoot(grasp.context)
    hand = tp.HandGeometry.from_plant(grasp.station.plant, plant_context, grasp.station.hand.palm_frame)
    estimate = tp.estimate_pose(model, contacts, prior=prior, hand=hand)
    return Outcome(
        seen,
        stated,
        squared,
        hidden,
        errors(model, estimate.best.X_PO.GetAsMatrix34(), truth),
        bool(region_holds(model, estimate, truth[None], [0.95])[0, 0]),
        estimate.status,
    )


def run_trial(name: str, seed: int) -> dict[str, Outcome] | str:
    """Runs a grasp with both trackers; returns the reason if no attempt holds the object."""
    scenario = make_scenario(name, seed)
    model = scenario.object_model()
    for plan in plan_scenario(scenario, model)[: scenario.check.attempts]:
        station = make_station(scenario, plan, model=model)
        second = SecondTracker(station)

        def observe(view: RunView, station: Station = station, second: SecondTracker = second) -> None:
            time = view.context.get_time()
            if abs(time / PERIODS[TAKES] - round(time / PERIODS[TAKES])) < 1e-6:
                second.see(station, view.context)

        grasp = run_grasp(station, observer=observe)
        if grasp.stable:
            first = (station.diagram.GetSubsystemByName("vision")).GetOutputPort("vision")
            own = first.Eval(first.get_system().GetMyContextFromRoot(grasp.context))
            hidden = float(station.diagram.GetOutputPort("hidden_share").Eval(grasp.context)[0])
            return {
                LEAVES_OUT: judge(grasp, own, hidden),
                TAKES: judge(grasp, *second.vision()),
                NOTHING: judge(grasp, None, np.nan),
            }
    return grasp.reason


def run_study(objects: list[str], seeds: range, out: Path) -> dict[str, list[dict[str, Outcome]]]:
    """All trials by object. Each is appended to a file, with which another run continues."""
    path, kept = out / "trials.jsonl", {}
    if path.exists():
        kept = {(line["object"], line["seed"]): line["outcomes"] for line in map(json.loads, path.open())}
    wanted = [(name, seed) for seed in seeds for name in objects]
    spawn = multiprocessing.get_context("spawn")
    # About 100 MB of a simulated diagram's memory are freed only when its process ends.
    with ProcessPoolExecutor(1, mp_context=spawn, max_tasks_per_child=12) as executor, path.open("a") as file:
        for name, seed in track(wanted, description="grasps", console=Console(stderr=True)):
            if (name, seed) not in kept:
                outcomes = executor.submit(run_trial, name, seed).result()
                if not isinstance(outcomes, str):
                    outcomes = {key: dataclasses.asdict(outcome) for key, outcome in outcomes.items()}
                kept[name, seed] = outcomes
                file.write(json.dumps({"object": name, "seed": seed, "outcomes": outcomes}) + "\n")
                file.flush()
    return {
        name: [
            {key: Outcome(**outcome) for key, outcome in kept[name, seed].items()}
            for seed in seeds
            if isinstance(kept[name, seed], dict)
        ]
        for name in objects
    }


def main() -> None:
    """Runs the grasps, prints the table, and saves it and the plot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--grasps", type=int, default=20, help="of each object")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/depth_tracking_study"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.grasps)
    results = run_study(arguments.objects, seeds, arguments.out)
    text = markdown(results, seeds)
    print(text)
    (arguments.out / "depth_tracking_study.md").write_text(text, encoding="utf-8")
    save_plot(results, arguments.out / "depth_tracking_study.png")


if __name__ == "__main__":
    main()
