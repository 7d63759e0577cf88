"""The value of evidence beyond the contacts: simulated grasps, estimated without a prior from more and more evidence.

    python examples/thesis/beyond_contact.py --trials 100 --seed 0

Five fingertips touch, with the noise of section 4.3.1 of the thesis (0.9 mm, 5 degrees; interpreted as in
`grasp_trials.py`), and 0.05 N on each component of each force. The first table uses contact normals, as force-torque
sensors in fingertips give them. The second one uses contact points alone, as from sensors that only localise a contact.
All rows of a table use the same noise.

The hand's volume is that of its collision geometry at the true joint angles. Mass and friction are those of the
simulation. The object is held by the fingertips alone, as the balance of forces assumes.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, sections 4.3.1 and 6.4.
"""

import itertools
import math
import time
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import numpy as np
from grasp_library import OBJECTS, SimulatedGrasp, make_library, make_scenario
from grasp_trials import Noise, pose_errors
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.hand import load_hand_config, make_hand_plant
from tactopose_drake.station import Scenario

NOISE = Noise(0.0009, math.radians(5.0))
SIGMA_FORCE = 0.05  # N
# Drake's combination, 2 a b / (a + b), of the fingertips' and the object's coefficient.
FRICTION = {"bust": 0.9, "wine_glass": 2 * 0.9 * 0.8 / (0.9 + 0.8)}
ROWS = ((), ("hand",), ("friction",), ("balance",), ("hand", "balance"), ("hand", "friction", "balance"))


class Outcome(NamedTuple):
    """The result of one estimate.

    Attributes:
        success: whether its best pose is within the limits of a success.
        found: whether any of its hypotheses is.
        said: total probability of the hypotheses within the limits.
        translation: error of the best pose, m.
        rotation: error of the best pose, rad.
        seconds: CPU time.
    """

    success: bool
    found: bool
    said: float
    translation: float
    rotation: float
    seconds: float


def make_model(scenario: Scenario) -> tp.ObjectModel:
    """The model of the object with the simulation's mass."""
    mass = ET.parse(scenario.object_sdf()).findtext(".//mass")
    assert mass is not None
    return tp.ObjectModel.from_mesh(scenario.object_mesh(), mass=float(mass))


def gravity(scenario: Scenario) -> tp.ForceBalance:
    """Gravity in the palm frame of the scenario's hand."""
    plant, hand = make_hand_plant(load_hand_config(scenario.hand))
    X_BaseP = hand.palm_frame.CalcPoseInWorld(plant.CreateDefaultContext())
    R_WP = scenario.X_WBase.GetDeterministicValue().rotation() @ X_BaseP.rotation()
    return tp.ForceBalance(R_WP.inverse() @ plant.gravity_field().gravity_vector())


def touch(grasp: SimulatedGrasp, seed: tuple[int, int], has_normals: bool) -> tp.Contacts:
    """The contacts of a grasp with noise, and their forces."""
    unit = np.random.default_rng(seed).normal(size=(3, *grasp.p_PC.shape))
    n_PC = np.einsum("kij,kj->ki", exp_so3(NOISE.normal * unit[1]), grasp.n_PC)
    return tp.Contacts(
        grasp.p_PC + NOISE.position * unit[0],
        n_PC if has_normals else None,
        grasp.f_PC + SIGMA_FORCE * unit[2],
        sigma_position=NOISE.position,
        sigma_normal=NOISE.normal,
        sigma_force=SIGMA_FORCE,
    )


def run(model: tp.ObjectModel, contacts: tp.Contacts, evidence: dict[str, Any], X_PO: np.ndarray) -> Outcome:
    """Makes one estimate, and compares it with the true pose (3, 4)."""
    started = time.process_time()
    estimate = tp.estimate_pose(model, contacts, **evidence)
    seconds = time.process_time() - started
    poses = np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in estimate.hypotheses])
    errors = pose_errors(model, poses, X_PO)
    said = sum(h.probability for h, near in zip(estimate.hypotheses, errors.success, strict=True) if near)
    return Outcome(
        bool(errors.success[0]),
        bool(errors.success.any()),
        said,
        float(errors.translation[0]),
        float(errors.rotation[0]),
        seconds,
    )


def study(name: str, grasps: Sequence[SimulatedGrasp], seed: int, has_normals: bool) -> dict[str, list[Outcome]]:
    """The outcomes of each row for all grasps."""
    scenario = make_scenario(name)
    model, balance = make_model(scenario), gravity(scenario)
    outcomes: dict[str, list[Outcome]] = {" + ".join(row) or "contacts alone": [] for row in ROWS}
    for i, grasp in enumerate(track(grasps, description=name, console=Console(stderr=True), transient=True)):
        contacts = touch(grasp, (seed, i), has_normals)
        hand = tp.HandGeometry(grasp.p_PH, grasp.radius)
        known = {"hand": hand, "balance": balance, "friction": FRICTION[name]}
        for row, runs in zip(ROWS, outcomes.values(), strict=True):
            runs.append(run(model, contacts, {kind: known[kind] for kind in row}, grasp.X_PO))
    return outcomes


def make_table(title: str, outcomes: dict[str, list[Outcome]]) -> Table:
    """A table with a row for each combination of evidence."""
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("besides", no_wrap=True)
    for heading in ("success, %", "found, %", "said, %", "mm", "deg", "ms"):
        table.add_column(heading, justify="right", no_wrap=True)
    for evidence, runs in outcomes.items():
        success, found, said, translation, rotation, seconds = np.array(runs, dtype=np.float64).T
        shares = (100.0 * values.mean() for values in (success, found, said))
        medians = 1e3 * np.median(translation), np.degrees(np.median(rotation)), 1e3 * np.median(seconds)
        table.add_row(evidence, *(f"{share:.0f}" for share in shares), *(f"{median:.1f}" for median in medians))
    return table


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--trials", type=click.IntRange(min=1), default=100, show_default=True, help="Grasps of each object.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the noise.")
def main(trials: int, seed: int) -> None:
    """Prints a table for each object, with normals and without."""
    console = Console()
    for name, has_normals in itertools.product(OBJECTS, (True, False)):
        outcomes = study(name, make_library(name, trials), seed, has_normals)
        what = "points and normals" if has_normals else "points alone"
        console.print(make_table(f"The {name.replace('_', ' ')} by {what}, {trials} grasps", outcomes))
    console.print(
        "success: the best pose is within 10 mm and 15° of the truth; found: some hypothesis is; said: the probability "
        "that the hypotheses give to such poses; mm, deg, ms: median errors of the best pose and CPU time."
    )


if __name__ == "__main__":
    main()
