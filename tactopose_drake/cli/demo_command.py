"""`tactopose demo`: a simulated hand closes on an object, and corrects the camera's pose by touch."""

import sys
from pathlib import Path

import click
from pydrake.geometry import Meshcat, MeshcatParams

from tactopose_drake.cli.consoles import ERRORS, OUT
from tactopose_drake.cli.demo_run import DemoResult, earlier_results, prepare_demo, run_demo, save_demo
from tactopose_drake.cli.reports import fingers_table, pads_table, poses_table
from tactopose_drake.estimation.descriptions import free_line, sigma_line, status_line
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.station.simulated import check_bodies
from tactopose_drake.visualization.presentation import open_page

# The demo's scenarios by the hand's name on the command line.
_DEMO_SCENARIOS = {"shadow": "shadow_like", "barrett": "barrett_like"}
_FOLDER = "tactopose_demo"
_path = click.Path(path_type=Path)


@click.command()
@click.option("--hand", type=click.Choice(list(_DEMO_SCENARIOS)), default="shadow", show_default=True, help="Hand.")
@click.option("--object", "name", help="One of the shipped objects; by default one that suits the hand.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the grasp and all noise.")
@click.option(
    "--out",
    type=_path,
    show_default="tactopose_demo, or where that has results already, tactopose_demo_2 and so on",
    help="Folder for the results; those of an earlier run there are replaced.",
)
@click.option("--meshcat", "keep", is_flag=True, help="Shows the run live in Meshcat, until you press Enter.")
@click.option("--no-open", is_flag=True, help="Does not open the web page at the end.")
def demo(hand: str, name: str | None, seed: int, out: Path | None, keep: bool, no_open: bool) -> None:
    """Closes a simulated hand on an object and corrects the camera's doubtful pose by touch."""
    scenario = load_scenario(_DEMO_SCENARIOS[hand])
    scenario.object, scenario.seed = name or scenario.object, seed
    scenario.validate()
    out = _free_folder() if out is None else out
    replaced = prepare_demo(out)
    check_bodies(scenario)
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    if keep:
        OUT.print(f"Meshcat shows the run at {meshcat.web_url()}")
    with ERRORS.status("reading the object") as status:
        result = run_demo(scenario, meshcat=meshcat, on_progress=status.update)
        status.update("writing the results")
        paths = save_demo(result, out, meshcat)
    for reason in result.grasp.failed_attempts:
        OUT.print(f"A grasp failed ({reason}); the next one was taken.")
    OUT.print(
        f"{' and '.join(_holders(result))} hold the {scenario.object.replace('_', ' ')}; "
        f"the hand hides {result.hidden_share:.0%} of it from the camera."
    )
    if result.fingers:
        OUT.print(fingers_table(result.fingers))
    if result.pads:
        OUT.print(pads_table(result.pads))
    OUT.print(poses_table((result.vision, result.touch)))
    OUT.print(free_line(result.estimate.best))
    OUT.print(sigma_line(result.estimate.best, result.grasp.station.model.size))
    OUT.print(status_line(result.estimate))
    OUT.print("Written: " + ", ".join(str(path) for path in paths), soft_wrap=True)
    if replaced:
        OUT.print("Replaced, of an earlier run: " + ", ".join(str(path) for path in replaced), soft_wrap=True)
    if not no_open and sys.stdout.isatty():
        open_page(paths[-1])
    if keep:
        click.pause("Press Enter to end.")


def _holders(result: DemoResult) -> list[str]:
    """What feels the object, counted."""
    felt = {"fingertips": len(result.fingers), "tactile pads": sum(pad.active_cells > 0 for pad in result.pads)}
    return [f"{count} {name}" for name, count in felt.items() if count]


def _free_folder() -> Path:
    """The first of the usual folders in which no earlier run has left its results."""
    number, folder = 1, Path(_FOLDER)
    while earlier_results(folder):
        number += 1
        folder = Path(f"{_FOLDER}_{number}")
    return folder
