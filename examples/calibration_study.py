"""Calibrations of hands with errors, and their effect on new grasps of other objects.

Each trial draws a hand's errors, grasps one object repeatedly, and calibrates the hand from its readings. The hand then
grasps other objects: with its errors known exactly, calibrated, uncalibrated, and at the bound, with errors drawn from
the Cramer-Rao bound of the calibration's grasps (`calibration_bound.py`). Grasps are made with kinematics alone, or in
the simulator, where each takes up to a minute.

python examples/calibration_study.py --trials 3
python examples/calibration_study.py --trials 40 --seed 0
python examples/calibration_study.py --trials 1 --grasps 12 --simulated
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path

import numpy as np
from calibration_bound import least_covariance
from rich.console import Console
from rich.progress import track
from rich.table import Table
from simulated_grasps import as_simulated, simulated_grasps, simulated_scenario

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3, transform_points
from tactopose_drake.hand import (
    ClosedGrasp,
    ClosedGraspParams,
    GraspCloser,
    HandConfig,
    HandErrors,
    HandUncertainty,
    NamedJoints,
    calibration_of,
    load_hand_config,
    make_hand_plant,
    save_calibration,
)
from tactopose_drake.resources import model_path
from tactopose_drake.systems import MakePoseEstimation, PoseEstimationParams

DECLARED = HandUncertainty(encoder_offset_deg=2.0, fingertip_radius=0.001, sensor_force=0.1, sensor_moment=0.001)
NOISE = ClosedGraspParams(noise_surface=0.0003, noise_normal_deg=1.5, noise_moment=0.00002, noise_force=0.004)
PRIOR = (0.033, np.radians(16.0))  # standard deviations of the prior of a new grasp, m and rad


@dataclasses.dataclass
class Trial:
    """The results of one hand.

    Attributes:
        inside: which of its errors are in the calibration's 95 % intervals.
        scaled: deviations of its errors from the calibration, divided by the calibration's standard deviations.
        offsets: remaining joint offsets, deg.
        errors: errors of the new grasps, by what is known of the hand, m: root mean square over the object's surface.
        left_out: number of grasps that the calibration ignored.
    """

    inside: np.ndarray
    scaled: np.ndarray
    offsets: np.ndarray
    errors: dict[str, list[float]]
    left_out: int


class DrawnHand:
    """A hand with random errors, which grasps objects.

    Attributes:
        config: the hand, with the standard deviations of its errors.
        errors: the errors that it may have.
        truth: their true values, shape (d,), SI units.
        generator: the random generator.
    """

    def __init__(self, hand: str, generator: np.random.Generator, simulated: bool) -> None:
        self.config = dataclasses.replace(load_hand_config(hand), uncertainty=DECLARED)
        self._plant, self._parts = make_hand_plant(self.config)
        self.errors = HandErrors.of(self._plant, self._parts, DECLARED)
        self.truth = self.errors.sigma * generator.normal(size=len(self.errors.sigma))
        self.generator, self._simulated, self._hand = generator, simulated, hand

    def grasps(self, objects: dict[str, tp.ObjectModel], count: int) -> list[ClosedGrasp]:
        """Makes `count` grasps, of the objects in turn."""
        if not self._simulated:
            closer = GraspCloser(self._plant, self._parts, self.errors, self.truth, NOISE)
            models = list(objects.values())
            return [closer.grasp(models[i % len(models)], self.generator) for i in range(count)]
        found: list[ClosedGrasp] = []
        for k, (name, model) in enumerate(objects.items()):
            scenario = simulated_scenario(self._hand, name, as_simulated(self.errors, self.truth))
            found += simulated_grasps(scenario, model, len(range(k, count, len(objects))), self.generator)
        return found

    def least_covariance(self, grasps: list[ClosedGrasp], noise: tuple[float, float]) -> np.ndarray:
        """The bound of its errors, (d, d), SI units, given these grasps and the contacts' noise, m and rad."""
        return least_covariance(self._plant, self._parts, self.errors, self.truth, grasps, noise)


def run_trial(hand: DrawnHand, known: str, objects: dict[str, tp.ObjectModel], count: int) -> Trial:
    """Calibrates a hand with one object, and tests it on the others."""
    config, errors, truth, generator = hand.config, hand.errors, hand.truth, hand.generator
    others = {name: model for name, model in objects.items() if name != known}
    held = hand.grasps({known: objects[known]}, count)
    result = tp.calibrate_hand(config, [grasp.recorded for grasp in held])
    new = hand.grasps(others, count)
    guesses = [disturbed(grasp.X_PO, generator) for grasp in new]
    with tempfile.TemporaryDirectory() as folder:
        exact = calibration_of(errors, truth, np.zeros((len(truth), len(truth))), 0.0)
        noise = result.calibration.noise
        least = hand.least_covariance(held, (noise.position, np.radians(noise.normal_deg)))
        drawn = generator.spawn(1)[0].multivariate_normal(truth, least)
        at_bound = calibration_of(errors, drawn, least, 0.0)
        exact.noise = at_bound.noise = noise
        found = {}
        calibrations = {"known": exact, "calibrated": result.calibration, "at the bound": at_bound}
        for name, calibration in calibrations.items():
            path = Path(folder) / f"{name.replace(' ', '_')}.yaml"
            save_calibration(path, calibration)
            found[name] = pose_errors(dataclasses.replace(config, calibration=str(path)), new, guesses)
        found["as it is"] = pose_errors(config, new, guesses)
    off = result.values - truth[errors.free]
    scaled = off / result.sigma
    is_offset = np.array([name.endswith("offset") for name in result.names])
    return Trial(
        np.abs(scaled) < 1.96, scaled, np.degrees(off[is_offset]), found, int(np.sum(result.grasp_weights < 0.5))
    )


def disturbed(X_PO: np.ndarray, generator: np.random.Generator) -> tp.PosePrior:
    """A prior of a pose, with random errors."""
    turned = X_PO[:, :3] @ exp_so3(PRIOR[1] * generator.normal(size=3))
    moved = X_PO[:, 3] + PRIOR[0] * generator.normal(size=3)
    return tp.PosePrior(np.column_stack([turned, moved]), sigma_translation=PRIOR[0], sigma_rotation=PRIOR[1])


def surface_error(model: tp.ObjectModel, X_PO: np.ndarray, X_PO_true: np.ndarray) -> float:
    """Root mean square distance of the object's surface between two poses, for the nearest symmetry image, m."""
    points = model.samples.points
    true = transform_points(X_PO_true, points)
    turned = transform_points(model.symmetry_poses, points)
    found = np.array([transform_points(X_PO, each) for each in turned])
    return float(np.sqrt(np.mean(np.sum((found - true) ** 2, axis=2), axis=1)).min())


def pose_errors(config: HandConfig, grasps: list[ClosedGrasp], priors: list[tp.PosePrior]) -> list[float]:
    """Errors of the estimates, made by the hand's own diagram and `estimate_pose`."""
    params = PoseEstimationParams(check_collisions=False, use_hand_volume=False)
    diagram = MakePoseEstimation(config, grasps[0].recorded.model, params)
    plant, parts = make_hand_plant(config)
    joints = NamedJoints(plant, parts)
    found = []
    for grasp, prior in zip(grasps, priors, strict=True):
        context, recorded = diagram.CreateDefaultContext(), grasp.recorded
        q = joints.positions(
            "joint_positions", dict(recorded.joint_positions)
        )  # NaN of the wrist's, which do not matter
        diagram.GetInputPort("joint_positions").FixValue(context, np.nan_to_num(q))
        for finger in parts.sensor_frames:
            wrench = recorded.wrenches.get(finger, np.zeros(6))
            diagram.GetInputPort(f"wrench_{finger}").FixValue(context, wrench)
        contacts = diagram.GetOutputPort("contacts").Eval(context)
        best = tp.estimate_pose(recorded.model, contacts, prior=prior).best
        found.append(surface_error(recorded.model, best.X_PO.GetAsMatrix34(), grasp.X_PO))
    return found


def main() -> None:
    """Prints a line for each hand, and the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hand", default="shadow_like")
    parser.add_argument("--object", default="spray_bottle", help="that the hand is calibrated with")
    parser.add_argument("--others", nargs="+", default=["bust", "mug", "tea_box"])
    parser.add_argument("--grasps", type=int, default=20, help="for a calibration, and as many new ones")
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--simulated", action="store_true", help="grasps of the simulator")
    arguments = parser.parse_args()
    console = Console()
    objects = {
        name: tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
        for name in (arguments.object, *arguments.others)
    }
    table = Table(title="Hands with errors: new grasps, mm off (median), and what the calibration said of itself")
    for heading in (
        "seed",
        "as it is",
        "calibrated",
        "at the bound",
        "known",
        "in 95 % intervals",
        "joints left, deg rms",
        "left out",
    ):
        table.add_column(heading, justify="right")
    trials = []
    for seed in track(range(arguments.seed, arguments.seed + arguments.trials), console=Console(stderr=True)):
        hand = DrawnHand(arguments.hand, np.random.default_rng(seed), arguments.simulated)
        trial = run_trial(hand, arguments.object, objects, arguments.grasps)
        trials.append(trial)
        medians = [
            f"{1e3 * np.median(trial.errors[name]):.2f}" for name in ("as it is", "calibrated", "at the bound", "known")
        ]
        rms = f"{np.sqrt(np.mean(trial.offsets**2)):.2f}"
        table.add_row(str(seed), *medians, f"{np.mean(trial.inside):.0%}", rms, str(trial.left_out))
    console.print(table)
    inside = np.concatenate([trial.inside for trial in trials])
    scaled = np.concatenate([trial.scaled for trial in trials])
    medians = {name: np.median(np.concatenate([t.errors[name] for t in trials])) for name in trials[0].errors}
    console.print(
        f"{len(trials)} hands, {arguments.grasps} grasps of {arguments.object} each, and as many of others: median "
        + ", ".join(f"{1e3 * value:.2f} mm {name}" for name, value in medians.items())
        + f"; calibrated over known {medians['calibrated'] / medians['known']:.2f}, at the bound "
        f"{medians['at the bound'] / medians['known']:.2f}.\n"
        f"{np.mean(inside):.1%} of {len(inside)} errors in their own 95 % intervals; scaled deviations "
        f"{np.sqrt(np.mean(scaled**2)):.2f} rms."
    )


if __name__ == "__main__":
    main()
