"""Calibration of the estimates for hands and meshes with declared errors, in simulated grasps.

python examples/declared_errors.py --grasps 40
python examples/declared_errors.py --errors 0 4 --grasps 10 --first-seed 100

The simulated hand has errors drawn from the defaults of `uncertainty:`. In each row, one property of the hand or the
object is worse, and the estimate knows by how much. The sensors were tared some time before a grasp and have drifted
since, as declared. Wrenches and joint positions go through the whole diagram. The study counts how often the smallest
set of hypotheses with 95 % of the probability contains the truth; how often both errors are smaller than vision's in
the directions that the touch determines; and how often the status is "held", which means that no pose explains the
touch.
"""

import argparse
import dataclasses
import re
import tempfile
from pathlib import Path

import numpy as np
from calibration import region_holds
from rich.console import Console
from rich.progress import track

from tactopose_drake.core.grasping import GraspPlan
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.posterior import determined_part
from tactopose_drake.core.shape import ObjectModel
from tactopose_drake.hand import HandUncertainty, load_hand_config
from tactopose_drake.resources import model_path
from tactopose_drake.runs import GraspResult, run_grasp
from tactopose_drake.station import (
    FingerErrors,
    Scenario,
    SimulatedErrors,
    load_scenario,
    make_station,
    plan_scenario,
)

OBJECTS = ("bust", "mug", "spray_bottle", "tea_box", "wine_glass")
HAND = "shadow_like"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """The declared errors of a row; those that are None are drawn with the defaults.

    Attributes:
        joints: offset of each joint, deg; its sign is random.
        force: bias of each component of the force, N; its sign is random.
        moment: bias of each component of the moment, N m; its sign is random.
        radius: by how much the radius of each fingertip is larger, m.
        scale: by which share the object is larger.
    """

    joints: float | None = None
    force: float | None = None
    moment: float | None = None
    radius: float | None = None
    scale: float = 0.0

    def uncertainty(self) -> HandUncertainty:
        """The uncertainty that the hand's file declares."""
        told = {
            "encoder_offset_deg": self.joints,
            "sensor_force": self.force,
            "sensor_moment": self.moment,
            "fingertip_radius": self.radius,
        }
        return HandUncertainty(**{name: value for name, value in told.items() if value is not None})

    def errors(self, seed: int) -> SimulatedErrors:
        """The true errors; the signs and all errors that are not given are drawn with the seed."""
        generator = np.random.default_rng([seed, 95])
        hand = load_hand_config(HAND)
        joints = dict.fromkeys(joint for finger in hand.fingers for joint in finger.joints)
        offsets = {} if self.joints is None else {joint: float(_signs(generator, self.joints)[0]) for joint in joints}
        fingers = {
            finger.name: FingerErrors(
                radius=self.radius,
                sensor_force=[] if self.force is None else _signs(generator, self.force).tolist(),
                sensor_moment=[] if self.moment is None else _signs(generator, self.moment).tolist(),
            )
            for finger in hand.fingers
        }
        return SimulatedErrors(
            drawn=True,
            seed=seed,
            tared=False,
            joint_offsets_deg=offsets,
            fingers=fingers,
            object_scale=1.0 + self.scale,
        )


def _signs(generator: np.random.Generator, size: float) -> np.ndarray:
    return size * generator.choice([-1.0, 1.0], size=3)


ROWS = {
    "a good hand": Row(),
    "joints off by 2 degrees": Row(joints=2.0),
    "bias 0.1 N and 1 N mm": Row(force=0.1, moment=0.001),
    "fingertips 1 mm thicker": Row(radius=0.001),
    "object 3 % larger": Row(scale=0.03),
    "all of these": Row(joints=2.0, force=0.1, moment=0.001, radius=0.001, scale=0.03),
}


@dataclasses.dataclass(frozen=True)
class Trial:
    """The result of one grasp's estimate.

    Attributes:
        inside: whether the truth is in the 95 % set.
        corrected: whether both errors are smaller than vision's.
        held: whether the status is "held".
        translation, rotation: errors in the directions that the touch determines, m and rad.
    """

    inside: bool
    corrected: bool
    held: bool
    translation: float
    rotation: float


def make_scenario(row: Row, name: str, seed: int, folder: Path) -> Scenario:
    """The shipped scenario with the row's errors, and a copy of its hand in `folder` that declares them."""
    shipped = model_path("hands", HAND, f"{HAND}.hand.yaml").read_text(encoding="utf-8")
    told = ", ".join(f"{key}: {value!r}" for key, value in dataclasses.asdict(row.uncertainty()).items())
    path = folder / f"{len(list(folder.iterdir()))}.hand.yaml"
    kept = re.sub(r"^uncertainty:.*\n(?:  .*\n)*", "", shipped, flags=re.MULTILINE)
    path.write_text(f"{kept}uncertainty: {{{told}}}\n", encoding="utf-8")
    scenario = load_scenario(HAND)
    scenario.hand, scenario.object, scenario.seed = str(path), name, seed
    scenario.scale_sigma, scenario.errors = row.scale, row.errors(seed)
    scenario.estimation.estimator.period = 0.4  # s; only the last estimate counts
    return scenario


def simulate(scenario: Scenario, plans: list[GraspPlan], model: ObjectModel) -> GraspResult:
    """Runs the grasps up to the first that holds the object; returns that or the last."""
    for plan in plans:
        result = run_grasp(make_station(scenario, plan, model=model))
        if result.stable:
            break
    return result


def judge(grasp: GraspResult) -> Trial:
    """Compares the diagram's outputs at the end with the truth."""
    read = {name: grasp.station.diagram.GetOutputPort(name).Eval(grasp.context) for name in _READ}
    estimate, model, X_PO = read["hypotheses"], grasp.station.model, grasp.X_PO.GetAsMatrix34()
    free = estimate.best.free_directions
    before, after = (
        determined_part(increments_between(X_PO_said, X_PO), free, model.size)
        for X_PO_said in (read["prior"].mean, read["object_pose"].GetAsMatrix34())
    )
    (turned_before, moved_before), (turned, moved) = (np.linalg.norm(e.reshape(2, 3), axis=1) for e in (before, after))
    return Trial(
        bool(region_holds(model, estimate, X_PO[None], [0.95])[0, 0]),
        bool(turned < turned_before and moved < moved_before),
        read["status"].startswith("held"),
        float(moved),
        float(turned),
    )


_READ = ("hypotheses", "prior", "object_pose", "status")


def line(name: str, trials: list[Trial], dropped: int) -> str:
    """A row of the table."""
    if not trials:
        return f"{name:26s} none of {dropped} grasps held the object"
    return (
        f"{name:26s} {len(trials):3d} grasps, {dropped} did not hold the object; truth in the 95 % set "
        f"{np.mean([trial.inside for trial in trials]):6.1%}, both errors fell "
        f"{np.mean([trial.corrected for trial in trials]):6.1%}, said held "
        f"{np.mean([trial.held for trial in trials]):6.1%}; medians "
        f"{1e3 * np.median([trial.translation for trial in trials]):.1f} mm, "
        f"{np.degrees(np.median([trial.rotation for trial in trials])):.1f} deg"
    )


def main() -> None:
    """Prints a line for each kind of error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasps", type=int, default=40, help="of each row, the objects in turn")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--errors", nargs="+", type=int, default=list(range(len(ROWS))), help="rows by their numbers")
    arguments = parser.parse_args()
    console = Console(width=200)
    names = [list(ROWS)[i] for i in arguments.errors]
    trials: dict[str, list[Trial]] = {name: [] for name in names}
    dropped = dict.fromkeys(names, 0)
    for seed in track(range(arguments.first_seed, arguments.first_seed + arguments.grasps), description="grasps"):
        with tempfile.TemporaryDirectory() as folder:
            scenarios = [make_scenario(ROWS[name], OBJECTS[seed % len(OBJECTS)], seed, Path(folder)) for name in names]
            # Plans depend on the files alone, which are the same in all rows.
            plans = plan_scenario(scenarios[0])[: scenarios[0].check.attempts]
            for name, scenario in zip(names, scenarios, strict=True):
                grasp = simulate(scenario, plans, scenario.object_model())
                if grasp.stable:
                    trials[name].append(judge(grasp))
                else:
                    dropped[name] += 1
    for name in names:
        console.print(line(name, trials[name], dropped[name]))


if __name__ == "__main__":
    main()
