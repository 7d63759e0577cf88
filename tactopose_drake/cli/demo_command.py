"""`tactopose demo`: a simulated hand closes on an object, and corrects the camera's pose by touch."""

import os
import sys
import webbrowser
from pathlib import Path

import click
from pydrake.geometry import Meshcat, MeshcatParams

from tactopose_drake.cli.consoles import ERRORS, OUT
from tactopose_drake.cli.demo_run import DemoResult, prepare_demo, run_demo, save_demo
from tactopose_drake.cli.demo_scenario import demo_scenario
from tactopose_drake.cli.reports import fingers_table, free_line, pads_table, poses_table, sigma_line, status_line
from tactopose_drake.station.simulated import check_bodies

_path = click.Path(path_type=Path)


@click.command()
@click.option("--hand", default="shadow", show_default=True, help="shadow, barrett, or a hand's YAML file by its path.")
@click.option(
    "--object", "name", help="A shipped object by name, or a mesh or model by path; by default a shipped one."
)
@click.option("--scale", type=float, default=1.0, show_default=True, help="Metres in the unit of the object's mesh.")
@click.option("--mass", type=float, help="Of the object, kg; by default what its file says, or water's.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the grasp and all noise.")
@click.option("--out", type=_path, default="tactopose_demo", show_default=True, help="Folder for the results.")
@click.option("--meshcat", "keep", is_flag=True, help="Shows the run live in Meshcat, until you press Enter.")
@click.option("--no-open", is_flag=True, help="Does not open the web page at the end.")
def demo(
    hand: str,
    name: str | None,
    scale: float,
    mass: float | None,
    seed: int,
    out: Path,
    keep: bool,
    no_open: bool,
) -> None:
    """Closes a simulated hand on an object and corrects the camera's doubtful pose by touch."""
    prepare_demo(out)
    with ERRORS.status("reading the hand"):
        scenario = demo_scenario(hand, name, seed, out, scale, mass)
    scenario.validate()
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
        f"{' and '.join(_holders(result))} hold the {result.grasp.station.model.name.replace('_', ' ')}; "
        f"the hand hides {result.hidden_share:.0%} of it from the camera."
    )
    if result.fingers:
        OUT.print(fingers_table(result.fingers))
    if result.pads:
        OUT.print(pads_table(result.pads))
    OUT.print(poses_table((result.vision, result.touch)))
    OUT.print(free_line(result.estimate.best))
    OUT.print(sigma_line(result.estimate.best, result.grasp.station.model))
    OUT.print(status_line(result.estimate))
    OUT.print("Written: " + ", ".join(str(path) for path in paths))
    page = paths[-1].absolute()
    if not no_open and sys.stdout.isatty() and _has_display():
        webbrowser.open(page.as_uri())
    if keep:
        click.pause("Press Enter to end.")


def _holders(result: DemoResult) -> list[str]:
    """What feels the object, counted."""
    felt = {"fingertips": len(result.fingers), "tactile pads": sum(pad.active_cells > 0 for pad in result.pads)}
    return [f"{count} {name}" for name, count in felt.items() if count]


def _has_display() -> bool:
    return sys.platform in ("darwin", "win32") or any(name in os.environ for name in ("DISPLAY", "WAYLAND_DISPLAY"))
