"""The command line, `tactopose`.

Exit status: 0 an estimate was made; 2 unusable input, with one line on stderr that says what and where; 1 anything
else.
"""

import logging
import os
import signal
import sys
import warnings
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import click
from pydrake.geometry import Meshcat, MeshcatParams

from tactopose_drake.cli.consoles import ERRORS, OUT
from tactopose_drake.cli.demo_run import DemoResult, prepare_demo, run_demo, save_demo
from tactopose_drake.cli.identify_command import identify_command
from tactopose_drake.cli.reports import (
    fingers_table,
    free_line,
    hypotheses_table,
    pads_table,
    poses_table,
    sigma_line,
    status_line,
)
from tactopose_drake.cli.run_commands import replay, run
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError, TactoposeError
from tactopose_drake.estimation.estimate import METHODS, estimate_pose
from tactopose_drake.estimation.files import load_contacts, load_prior, save_result
from tactopose_drake.estimation.output_files import check_outputs
from tactopose_drake.station.scenario import load_scenario
from tactopose_drake.station.simulated import check_bodies
from tactopose_drake.visualization.meshcat import aim_camera, draw_scene, save_html, upright
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat
from tactopose_drake.visualization.scene import Scene

_UNUSABLE_INPUT = 2
_console, _errors = OUT, ERRORS

# The demo's scenarios by the hand's name on the command line.
_DEMO_SCENARIOS = {"shadow": "shadow_like", "barrett": "barrett_like"}
_path = click.Path(path_type=Path)


class InterruptedRunError(Exception):
    """An interrupt from the keyboard; click itself would print a line of its own."""


class _Commands(click.Group):
    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise InterruptedRunError from None


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="tactopose_drake")
def cli() -> None:
    """Knows where a grasped object is, from touch."""


@cli.command()
@click.option("--object", "mesh", type=_path, required=True, help="Mesh of the object, in metres.")
@click.option("--contacts", "contacts_file", type=_path, required=True, help="contacts.yaml: the touch.")
@click.option("--prior", "prior_file", type=_path, help="prior.yaml: what is known of the pose without touch.")
@click.option("--method", type=click.Choice(list(METHODS)), default="pair_search", show_default=True, help="Search.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the search's random numbers."
)
@click.option("--out", type=_path, help="Writes result.json here.")
@click.option("--html", type=_path, help="Writes the scene here, as a web page to turn and zoom.")
@click.option("--meshcat-url", help="Draws the scene into the meshcat-server there, e.g. tcp://127.0.0.1:6000.")
def estimate(
    mesh: Path,
    contacts_file: Path,
    prior_file: Path | None,
    method: str,
    seed: int,
    out: Path | None,
    html: Path | None,
    meshcat_url: str | None,
) -> None:
    """Estimates the pose of an object from contacts."""
    contacts = load_contacts(contacts_file)
    prior = None if prior_file is None else load_prior(prior_file)
    check_outputs((out, html), inputs=(mesh, contacts_file, prior_file))
    remote = None if meshcat_url is None else click.get_current_context().with_resource(RemoteMeshcat(meshcat_url))
    with _progress(f"reading {mesh}"):
        model = ObjectModel.from_mesh(mesh)
    with _progress("searching (the first run on a machine compiles its kernels, about a minute)"):
        found = estimate_pose(model, contacts, prior=prior, method=method, seed=seed)
    _console.print(hypotheses_table(found, model))
    _console.print(free_line(found.best))
    _console.print(status_line(found))
    if out is not None:
        save_result(out, found)
    scene = Scene(
        model=model,
        contacts=contacts,
        prior=None if prior is None else prior.X_PO,
        estimate=found.best.X_PO,
    )
    if html is not None:
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        draw_scene(meshcat, scene)
        aim_camera(meshcat, scene, upright(scene))
        save_html(html, meshcat)
    if remote is not None:
        draw_scene(remote, scene)
        _console.print(f"Drawn into the meshcat-server whose page is {remote.web_url()}")


@cli.command()
@click.option("--hand", type=click.Choice(list(_DEMO_SCENARIOS)), default="shadow", show_default=True, help="Hand.")
@click.option("--object", "name", help="One of the shipped objects; by default one that suits the hand.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the grasp and all noise.")
@click.option("--out", type=_path, default="tactopose_demo", show_default=True, help="Folder for the results.")
@click.option("--meshcat", "keep", is_flag=True, help="Shows the run live in Meshcat, until you press Enter.")
@click.option("--no-open", is_flag=True, help="Does not open the web page at the end.")
def demo(hand: str, name: str | None, seed: int, out: Path, keep: bool, no_open: bool) -> None:
    """Closes a simulated hand on an object and corrects the camera's doubtful pose by touch."""
    scenario = load_scenario(_DEMO_SCENARIOS[hand])
    scenario.object, scenario.seed = name or scenario.object, seed
    scenario.validate()
    prepare_demo(out)
    check_bodies(scenario)
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    if keep:
        _console.print(f"Meshcat shows the run at {meshcat.web_url()}")
    with _errors.status("reading the object") as status:
        result = run_demo(scenario, meshcat=meshcat, on_progress=status.update)
        status.update("writing the results")
        paths = save_demo(result, out, meshcat)
    for reason in result.grasp.failed_attempts:
        _console.print(f"A grasp failed ({reason}); the next one was taken.")
    _console.print(
        f"{' and '.join(_holders(result))} hold the {scenario.object.replace('_', ' ')}; "
        f"the hand hides {result.hidden_share:.0%} of it from the camera."
    )
    if result.fingers:
        _console.print(fingers_table(result.fingers))
    if result.pads:
        _console.print(pads_table(result.pads))
    _console.print(poses_table((result.vision, result.touch)))
    _console.print(free_line(result.estimate.best))
    _console.print(sigma_line(result.estimate.best, result.grasp.station.model))
    _console.print(status_line(result.estimate))
    _console.print("Written: " + ", ".join(str(path) for path in paths))
    page = paths[-1].absolute()
    if not no_open and sys.stdout.isatty() and _has_display():
        webbrowser.open(page.as_uri())
    if keep:
        click.pause("Press Enter to end.")


def _holders(result: DemoResult) -> list[str]:
    """What feels the object, counted."""
    felt = {"fingertips": len(result.fingers), "tactile pads": sum(pad.active_cells > 0 for pad in result.pads)}
    return [f"{count} {name}" for name, count in felt.items() if count]


cli.add_command(identify_command)
cli.add_command(run)
cli.add_command(replay)


def _has_display() -> bool:
    return sys.platform in ("darwin", "win32") or any(name in os.environ for name in ("DISPLAY", "WAYLAND_DISPLAY"))


@contextmanager
def _progress(message: str) -> Iterator[None]:
    """Shows what takes its time, on a terminal; and what was repaired on the way."""
    with warnings.catch_warnings(record=True) as caught, _errors.status(message):
        warnings.simplefilter("always", MeshRepairWarning)
        yield
    for warning in caught:
        if issubclass(warning.category, MeshRepairWarning):
            _errors.print(f"warning: {warning.message}", style="yellow", markup=False)


def main() -> None:
    """The entry point of `tactopose`."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    logging.getLogger("can").setLevel(logging.ERROR)  # What a damaged log holds is said once, at its end.
    try:
        # It gives back what `Context.exit` and `click.exceptions.Exit` were given; commands give nothing.
        status = cli.main(standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        sys.exit(_UNUSABLE_INPUT)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "tactopose"
        _fail(f"{error.format_message()} `{command} --help` says what is allowed.")
    except InvalidInputError as error:
        _fail(str(error))
    except (TactoposeError, OSError) as error:
        _fail(str(error), status=1)
    except (InterruptedRunError, click.Abort):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # What closes from here on is not to be interrupted again.
        _fail("interrupted", status=1)
    sys.exit(status or 0)


def _fail(message: str, status: int = _UNUSABLE_INPUT) -> NoReturn:
    _errors.print("error: " + " ".join(message.split()), style="red", markup=False)
    sys.exit(status)
