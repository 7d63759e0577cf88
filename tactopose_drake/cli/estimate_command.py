"""`tactopose estimate`: the pose of an object from files."""

from pathlib import Path

import click
import numpy as np

from tactopose_drake import hand, visualization
from tactopose_drake.cli.consoles import ERRORS, OUT, reporting, tell_warnings
from tactopose_drake.cli.estimate_tables import hypotheses_table
from tactopose_drake.cli.option_types import HAND, HAND_HELP, OBJECT, OBJECT_HELP, PATH, object_file
from tactopose_drake.cli.symmetry_option import SYMMETRY_HELP, parse_symmetries
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import told_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.data_checks import naming_contacts_of
from tactopose_drake.estimation.descriptions import false_contacts_line, free_line, status_line, touch_names
from tactopose_drake.estimation.estimate import estimate_pose
from tactopose_drake.estimation.far_origins import about_middle
from tactopose_drake.estimation.files import load_prior, save_result
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.estimation.output_files import check_outputs
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.estimation.search_methods import METHODS


@click.command()
@click.option("--object", "name", type=OBJECT, required=True, help=f"{OBJECT_HELP}.")
@click.option("--scale", type=float, default=1.0, show_default=True, help="Metres in the mesh's unit: 0.001 for mm.")
@click.option("--symmetry", multiple=True, default=("auto",), show_default=True, help=SYMMETRY_HELP)
@click.option("--mass", type=float, help="Of the object, kg; by default what its SDF, URDF or MJCF says.")
@click.option("--contacts", "contacts_file", type=PATH, required=True, help="contacts.yaml: contacts, patches, planes.")
@click.option("--prior", "prior_file", type=PATH, help="prior.yaml: prior of the pose.")
@click.option("--hand-volume", "volume_file", type=PATH, help="YAML of the hand's volume, and its untouched parts.")
@click.option("--hand", "hand_name", type=HAND, help=f"{HAND_HELP}; if --hand-volume has joints and names no hand.")
@click.option("--friction", type=float, help="Coefficient of friction: no contact slips. Needs forces.")
@click.option(
    "--gravity",
    type=float,
    nargs=3,
    help="In the palm frame, m/s^2: the object rests under the contacts' forces alone. Needs forces and its mass.",
)
@click.option(
    "--outlier-probability",
    type=float,
    default=0.02,
    show_default=True,
    help="Probability that a contact is not on this object; 0 trusts every contact.",
)
@click.option("--method", type=click.Choice(list(METHODS)), default="pair_search", show_default=True, help="Search.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the search's random numbers."
)
@click.option("--out", type=PATH, help="Writes result.json here.")
@click.option("--html", type=PATH, help="Writes the scene here, as a web page to turn and zoom.")
@click.option("--meshcat-url", help="Draws the scene into the meshcat-server there, e.g. `tcp://127.0.0.1:6000`.")
def estimate(
    name: str,
    scale: float,
    symmetry: tuple[str, ...],
    mass: float | None,
    contacts_file: Path,
    prior_file: Path | None,
    volume_file: Path | None,
    hand_name: str | None,
    friction: float | None,
    gravity: tuple[float, float, float] | None,
    outlier_probability: float,
    method: str,
    seed: int,
    out: Path | None,
    html: Path | None,
    meshcat_url: str | None,
) -> None:
    """Estimates the pose of an object from what touches it."""
    tell_warnings(MeshRepairWarning)
    mesh, touch = object_file(name), hand.load_touch(contacts_file)
    prior = None if prior_file is None else load_prior(prior_file)
    own_hand = None if hand_name is None else hand.load_hand_config(hand_name)
    volumes = None if volume_file is None else hand.load_hand_volume(volume_file, own_hand)
    with told_of("--gravity: "):
        balance = None if gravity is None else ForceBalance(np.array(gravity))
    of_hand = None if hand_name is None else Path(hand_name)
    check_outputs((out, html), inputs=(mesh, contacts_file, prior_file, volume_file, of_hand))
    if hand_name is not None and volume_file is None:
        message = "warning: --hand is not used: it gives the hand of the joints in --hand-volume, which is missing."
        ERRORS.print(message, style="yellow", markup=False, soft_wrap=True)
    remote = None
    if meshcat_url is not None:
        remote = click.get_current_context().with_resource(visualization.RemoteMeshcat(meshcat_url))
    with ERRORS.status(f"reading {name}"):
        model = _load(mesh, scale, symmetry, mass)
    if balance is not None and not model.mass_is_known:
        raise InvalidInputError(
            f"--gravity must come with a mass, but that of {name} is not known. Give it by `--mass`, kg."
        )
    searching = ERRORS.status("searching (the first run on a machine compiles its kernels, about a minute)")
    with searching, naming_contacts_of(contacts_file):
        found = estimate_pose(
            model,
            touch.contacts,
            patches=touch.patches,
            planes=touch.planes,
            prior=prior,
            hand=None if volumes is None else volumes.hand,
            untouched=None if volumes is None else volumes.untouched,
            balance=balance,
            friction=friction,
            method=method,
            seed=seed,
            outlier_probability=outlier_probability,
        )
    with reporting((out, html), hypotheses_table(found, model), *_lines(found, model, touch)):
        if out is not None:
            save_result(out, found)
        if html is not None:
            found.save_html(html)
    if remote is not None:
        visualization.draw_scene(remote, visualization.scene_of(found))
        OUT.print(f"Drawn into the meshcat-server whose page is {remote.web_url()}", soft_wrap=True)


def _lines(found: PoseEstimate, model: ObjectModel, touch: hand.LoadedTouch) -> list[str]:
    """Sentences on the best hypothesis, and on the status."""
    lines = free_line(about_middle(found.best, model)), _false_line(found.best, touch), status_line(found)
    return [line for line in lines if line]


def _false_line(best: PoseHypothesis, touch: hand.LoadedTouch) -> str:
    """A sentence that lists the contacts and felt patches that are probably not on the object."""
    told = np.array([*[True] * len(touch.contacts), *(patch.is_felt for patch in touch.patches)])
    return false_contacts_line(best.inlier_probability[told] < 0.5, touch_names(len(touch.contacts), touch.patches))


def _load(mesh: Path, scale: float, symmetry: tuple[str, ...], mass: float | None) -> ObjectModel:
    if symmetry == ("auto",):
        return load_object(mesh, scale=scale, mass=mass)
    if symmetry != ("none",):
        parse_symmetries(symmetry, np.zeros(3))  # Reports invalid axes before the mesh is read.
    model = load_object(mesh, scale=scale, symmetry="none", mass=mass)
    if symmetry == ("none",):
        return model
    given = parse_symmetries(symmetry, model.center_of_mass)
    return load_object(mesh, scale=scale, symmetry=given, mass=mass)
