"""`tactopose demo`: a simulated hand closes on an object, and corrects the camera's pose by touch."""

import dataclasses
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform

from tactopose_drake.cli.consoles import ERRORS, OUT, tell_warnings
from tactopose_drake.cli.demo_run import DemoResult, earlier_results, prepare_demo, run_demo, save_demo
from tactopose_drake.cli.estimate_tables import fingers_table, pads_table, poses_table
from tactopose_drake.cli.option_types import HAND, HAND_HELP, OBJECT, OBJECT_HELP, PATH
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.validation import either
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.descriptions import free_line, sigma_line, status_line
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.resources import shipped_objects
from tactopose_drake.runs.grasp_simulation import GraspResult
from tactopose_drake.station.automatic_scenario import scenario_for
from tactopose_drake.station.object_sdf import write_simulated_object
from tactopose_drake.station.scenario import Scenario, load_scenario
from tactopose_drake.station.simulated import check_bodies
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tactopose_drake.visualization.presentation import open_page

_FOLDER = "tactopose_demo"
_WITH_SCENARIO = ("shadow_like", "barrett_like")  # hands that have a scenario with their name
_OBJECT = "cube"  # default object for other hands


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Options:
    """The values of the command's options."""

    hand: str
    name: str | None
    scale: float
    mass: float | None
    seed: int
    out: Path | None
    track: bool
    keep: bool
    no_open: bool


@click.command()
@click.option("--hand", type=HAND, default="shadow", show_default=True, help=f"{HAND_HELP}.")
@click.option("--object", "name", type=OBJECT, help=f"{OBJECT_HELP}; by default one of the package.")
@click.option("--scale", type=float, default=1.0, show_default=True, help="Metres in the unit of the object's mesh.")
@click.option("--mass", type=float, help="Of the object, kg; by default what its file says, or water's.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the grasp and all noise.")
@click.option(
    "--out",
    type=PATH,
    show_default="tactopose_demo, or where that has results already, tactopose_demo_2 and so on",
    help="Folder for the results; those of an earlier run there are replaced.",
)
@click.option("--track", is_flag=True, help="Tracks the object over time, and shows the belief.")
@click.option("--meshcat", "keep", is_flag=True, help="Shows the run live in Meshcat, until you press Enter.")
@click.option("--no-open", is_flag=True, help="Does not open the web page at the end.")
def demo(**given: Any) -> None:
    """Closes a simulated hand on an object and corrects the camera's uncertain pose by touch."""
    tell_warnings(MeshRepairWarning)
    options = _Options(**given)
    out = _free_folder() if options.out is None else options.out
    replaced = prepare_demo(out)
    with ERRORS.status("reading the hand"):
        # Files of the user's object stay in a temporary folder until there is a result.
        scratch = Path(click.get_current_context().with_resource(tempfile.TemporaryDirectory(prefix="tactopose_")))
        scenario = _scenario(options, scratch)
        own = sorted(scratch.iterdir())
        inputs = (Path(text) for text in (options.hand, options.name) if text and os.path.isfile(text))
        prepare_demo(out, (path.name for path in own), inputs)
    if options.track:
        scenario.tracking = PoseTrackingParams()
    scenario.validate()
    check_bodies(scenario)
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    if options.keep:
        OUT.print(f"Meshcat shows the run at {meshcat.web_url()}")
    with ERRORS.status("reading the object") as status:
        result = run_demo(scenario, meshcat=meshcat, on_progress=status.update)
        status.update("writing the results")
        paths = save_demo(result, out, meshcat, own)
    for reason in result.grasp.failed_attempts:
        OUT.print(f"A grasp failed ({reason}); the next one was taken.")
    OUT.print(
        f"{' and '.join(_holders(result))} hold the {result.grasp.station.model.name.replace('_', ' ')}; "
        f"the hand hides {result.hidden_share:.0%} of it from the camera."
    )
    if result.fingers:
        OUT.print(fingers_table(result.fingers))
    for sentence in result.disturbed:
        OUT.print(sentence, style="yellow")
    if result.pads:
        OUT.print(pads_table(result.pads))
    OUT.print(poses_table([pose for pose in (result.vision, result.touch, result.tracked) if pose is not None]))
    OUT.print(free_line(result.estimate.best))
    if widths := sigma_line(result.estimate.best, result.grasp.station.model.size):
        OUT.print(widths)
    OUT.print(status_line(result.estimate))
    if options.track:
        OUT.print(_belief_line(result.grasp))
    OUT.print("Written: " + ", ".join(str(path) for path in paths), soft_wrap=True)
    if replaced:
        OUT.print("Replaced, of an earlier run: " + ", ".join(str(path) for path in replaced), soft_wrap=True)
    if not options.no_open and sys.stdout.isatty():
        open_page(paths[-1])
    if options.keep:
        click.pause("Press Enter to end.")


def _scenario(options: _Options, folder: Path) -> Scenario:
    """The scenario of the package for a hand and object, or one made for the user's own.

    The folder is empty, and receives the SDF and OBJ of an object that is given by path.
    """
    hand, name = options.hand, options.name
    scenario = load_scenario(hand) if hand in _WITH_SCENARIO else None
    if scenario is not None and scenario.grip is not None and name is not None and name not in scenario.grip.X_PO:
        raise InvalidInputError(
            f"--object must be one that the hand {hand!r} can hold, which closes without a plan: "
            f"{either(sorted(scenario.grip.X_PO))}, not {name!r}. Other hands plan grasps of any object."
        )
    if name is not None and name not in shipped_objects():
        name = str(write_simulated_object(load_object(name, scale=options.scale, mass=options.mass), folder))
    elif options.scale != 1.0 or options.mass is not None:
        raise InvalidInputError("--scale and --mass must be left out unless --object is a file's path.")
    if scenario is None:
        return scenario_for(hand, name or _OBJECT, options.seed)
    scenario.object, scenario.seed = name or scenario.object, options.seed
    return scenario


def _belief_line(grasp: GraspResult) -> str:
    """A sentence on the belief over time at the end, and its error."""
    diagram, context = grasp.station.diagram, grasp.context
    status: str = diagram.GetOutputPort("tracked_status").Eval(context)
    X_PO: RigidTransform = diagram.GetOutputPort("tracked_object_pose").Eval(context)
    off = X_PO.translation() - grasp.X_PO.translation()
    return (
        f"Belief over time: {status}; {1e3 * float(np.linalg.norm(off)):.1f} mm off, including undetermined directions."
    )


def _holders(result: DemoResult) -> list[str]:
    """The numbers of fingertips and pads that feel the object, as text."""
    felt = {"fingertips": len(result.fingers), "tactile pads": sum(pad.active_cells > 0 for pad in result.pads)}
    return [f"{count} {name}" for name, count in felt.items() if count]


def _free_folder() -> Path:
    """The first of the default folders without results of an earlier run."""
    number, folder = 1, Path(_FOLDER)
    while earlier_results(folder):
        number += 1
        folder = Path(f"{_FOLDER}_{number}")
    return folder
