import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.estimate import estimate_pose
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.visualization.appearance import (
    ALTERNATIVE,
    AXIS_COLOURS,
    CONTACT,
    ESTIMATE,
    FREE,
    PRESSURE,
    PRIOR,
    TRUTH,
    UNCERTAINTY,
    Colour,
)
from tactopose_drake.visualization.body_meshes import Triangles
from tactopose_drake.visualization.picture import save_picture
from tactopose_drake.visualization.scene import Scene, ShownHypothesis
from tactopose_drake.visualization.viewpoint import choose_view, points_of_interest
from tests.core.models import brick

TOUCH = Contacts(
    [[0.03, 0, 0], [-0.03, 0, 0], [0, 0, 0.05]],
    [[1, 0, 0], [-1, 0, 0], [0, 0, 1]],
    [[2, 0, 0], [-1, 0, 0.2], [0, 0, 3.0]],
)
X_off = RigidTransform([0.03, 0.02, 0.01])


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return brick(0.06, 0.08, 0.1)


def wall(at: np.ndarray, normal: np.ndarray) -> Triangles:
    """A hand that is a square of 40 cm across a direction."""
    mesh = trimesh.creation.box((0.4, 0.4, 0.001), transform=trimesh.geometry.align_vectors([0, 0, 1], normal))
    mesh.apply_translation(at)
    return Triangles(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32), np.full((8, 3), 0.6))


def draw(path: Path, scene: Scene) -> np.ndarray:
    save_picture(path, scene)
    return imread(path)[..., :3]


def test_what_is_no_path_and_no_scene_is_named(model: ObjectModel, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"^path must be a path, not None"):
        save_picture(None, Scene(model=model, contacts=TOUCH))  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=r"^scene must be a Scene, not None"):
        save_picture(tmp_path / "picture.png", None)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["picture", "picture.result", "picture.pdf"])
def test_a_picture_is_a_png_whatever_its_name_ends_in(model: ObjectModel, tmp_path: Path, name: str) -> None:
    save_picture(tmp_path / name, Scene(model=model, contacts=TOUCH, hypotheses=(ShownHypothesis(RigidTransform()),)))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def share(image: np.ndarray, colour: Colour) -> float:
    """Share of the pixels above the legend whose hue is near a colour's."""
    pixels = image[60:-90].reshape(-1, 3)
    wanted = np.array(colour) - np.mean(colour)
    hues = pixels - pixels.mean(axis=1, keepdims=True)
    strong = np.linalg.norm(hues, axis=1) > 0.15
    cosine = hues @ wanted / np.maximum(np.linalg.norm(hues, axis=1) * np.linalg.norm(wanted), 1e-9)
    return float(np.mean(strong & (cosine > 0.97)))


def test_the_left_panel_shows_the_prior_and_the_right_one_the_estimate(model: ObjectModel, tmp_path: Path) -> None:
    scene = Scene(
        model=model,
        contacts=TOUCH,
        prior=X_off,
        hypotheses=(ShownHypothesis(RigidTransform()),),
        truth=RigidTransform(),
    )
    left, right = np.split(draw(tmp_path / "picture.png", scene), 2, axis=1)
    assert share(left, PRIOR.colour) > 0.1
    assert share(left, ESTIMATE.colour) < 0.001
    assert share(right, ESTIMATE.colour) > 0.1
    assert share(right, PRIOR.colour) < 0.02  # its outline only
    for panel in (left, right):
        assert share(panel, CONTACT.colour) > 0.002
        assert share(panel, TRUTH.colour) > 0.001


@pytest.mark.parametrize("contacts", [TOUCH, Contacts(TOUCH.p_PC), Contacts.empty()])
@pytest.mark.parametrize("poses", [{"hypotheses": (ShownHypothesis(X_off),)}, {"prior": X_off}])
def test_what_is_not_known_is_left_out(model: ObjectModel, tmp_path: Path, contacts: Contacts, poses) -> None:
    image = draw(tmp_path / "picture.png", Scene(model=model, contacts=contacts, **poses))
    assert image.shape[1] < 800  # one panel
    assert share(image, ESTIMATE.colour if "hypotheses" in poses else PRIOR.colour) > 0.1


def test_the_same_scene_gives_the_same_picture(model: ObjectModel, tmp_path: Path) -> None:
    scene = Scene(model=model, contacts=TOUCH, hypotheses=(ShownHypothesis(X_off),))
    np.testing.assert_array_equal(draw(tmp_path / "a.png", scene), draw(tmp_path / "b.png", scene))


def pads(pressure: float) -> tuple[Patch, ...]:
    """Four cells on each of the box's broad sides."""
    cells = [[0.0, y, z] for y in (-0.005, 0.005) for z in (-0.005, 0.005)]
    return tuple(
        describe_patch(
            np.add(cells, [0.031 * side, 0.0, 0.0]),
            np.full(4, pressure),
            alpha=1e-8,
            n_PT=np.tile([-side, 0.0, 0.0], (4, 1)),
            saturation=1e5,
        )
        for side in (-1.0, 1.0)
    )


def test_pressed_cells_are_plates_as_large_as_their_pressure(model: ObjectModel, tmp_path: Path) -> None:
    shares = []
    for pressure in (0.0, 2e4, 1e5):
        scene = Scene(
            model=model,
            contacts=Contacts.empty(),
            patches=pads(pressure),
            hypotheses=(ShownHypothesis(RigidTransform()),),
        )
        shares.append(share(draw(tmp_path / "picture.png", scene), PRESSURE.colour))
    none, few, many = shares
    assert none == 0.0
    assert few > 0.0
    assert 3.0 < many / few < 7.0  # In proportion, but for the plates' edges.


@pytest.mark.parametrize("side", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
def test_the_view_is_not_from_behind_the_hand(model: ObjectModel, side: tuple[float, float, float]) -> None:
    towards = np.array(side)
    hand = wall(0.09 * towards, towards)
    view = choose_view(
        Scene(model=model, contacts=Contacts.empty(), hypotheses=(ShownHypothesis(RigidTransform()),), hand=hand)
    )
    assert view @ towards < 0.5


def test_a_hand_within_the_object_is_not_seen(model: ObjectModel, tmp_path: Path) -> None:
    box = trimesh.creation.box((0.05, 0.07, 0.09))
    hand = Triangles(np.array(box.vertices), np.array(box.faces, dtype=np.int32), np.full((8, 3), 0.6))
    scenes = [
        Scene(model=model, contacts=Contacts.empty(), hypotheses=(ShownHypothesis(RigidTransform()),), hand=shown)
        for shown in (None, hand)
    ]
    bare, inside = (draw(tmp_path / "picture.png", scene)[:-90] for scene in scenes)  # but for the legend
    np.testing.assert_array_equal(bare, inside)


def test_a_hand_over_the_object_lets_it_shine_through(model: ObjectModel, tmp_path: Path) -> None:
    box = trimesh.creation.box((0.1, 0.12, 0.14))
    hand = Triangles(np.array(box.vertices), np.array(box.faces, dtype=np.int32), np.full((8, 3), 0.6))
    bare = draw(
        tmp_path / "a.png",
        Scene(model=model, contacts=Contacts.empty(), hypotheses=(ShownHypothesis(RigidTransform()),)),
    )
    inside = draw(
        tmp_path / "b.png",
        Scene(model=model, contacts=Contacts.empty(), hypotheses=(ShownHypothesis(RigidTransform()),), hand=hand),
    )
    assert 0.02 < share(inside, ESTIMATE.colour) < share(bare, ESTIMATE.colour)


def test_the_estimate_is_painted_as_its_vertices_are(model: ObjectModel, tmp_path: Path) -> None:
    red, blue = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)
    colours = np.where(model.vertices[:, 2:] > 0.0, red, blue)
    scene = Scene(model=model, contacts=Contacts.empty(), prior=X_off, hypotheses=(ShownHypothesis(RigidTransform()),))
    save_picture(tmp_path / "picture.png", scene, colours=colours)
    left, right = np.split(imread(tmp_path / "picture.png")[..., :3], 2, axis=1)
    assert share(right, red) > 0.03
    assert share(right, blue) > 0.03
    assert share(right, ESTIMATE.colour) < 0.01
    assert share(left, PRIOR.colour) > 0.1
    assert share(left, blue) < 0.001


def certain(X_PO: RigidTransform, probability: float, **known: object) -> ShownHypothesis:
    return ShownHypothesis(X_PO, probability, np.diag(np.square([0.05] * 3 + [0.004] * 3)), **known)


def test_how_sure_the_estimate_is_is_seen(model: ObjectModel, tmp_path: Path) -> None:
    spin = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    other = certain(RigidTransform([0.05, 0.05, 0.0]), 0.4)
    shares = {}
    for name, hypotheses in {
        "bare": (ShownHypothesis(RigidTransform()),),
        "sure": (certain(RigidTransform(), 1.0),),
        "free": (certain(RigidTransform(), 1.0, free_directions=spin),),
        "ambiguous": (certain(RigidTransform(), 0.6), other),
    }.items():
        image = draw(tmp_path / "picture.png", Scene(model=model, contacts=Contacts.empty(), hypotheses=hypotheses))
        shares[name] = {look: share(image, look.colour) for look in (FREE, ALTERNATIVE)}
        # Darker than any shade of the estimate.
        shares[name][UNCERTAINTY] = float(np.mean(np.all(image[60:-90] < [0.12, 0.22, 0.5], axis=2)))
    assert shares["bare"] == {FREE: 0.0, ALTERNATIVE: 0.0, UNCERTAINTY: 0.0}
    assert shares["sure"][UNCERTAINTY] > 0.002
    assert shares["free"][FREE] > 0.002
    assert shares["ambiguous"][ALTERNATIVE] > 0.005
    assert shares["sure"][FREE] == shares["free"][ALTERNATIVE] == 0.0


def test_other_hypotheses_do_not_blend_with_the_estimate(model: ObjectModel, tmp_path: Path) -> None:
    best, other = ShownHypothesis(RigidTransform(), 0.95), ShownHypothesis(RigidTransform([0.02, 0.03, 0.01]), 0.05)
    alone, both = (
        draw(tmp_path / "picture.png", Scene(model=model, contacts=Contacts.empty(), hypotheses=hypotheses))[60:-90]
        for hypotheses in ((best,), (best, other))
    )
    is_estimate = alone[..., 2] - alone[..., 0] > 0.2
    same = np.all(np.abs(alone - both) < 0.01, axis=2)
    assert np.mean(is_estimate) > 0.1
    assert np.mean(same[is_estimate]) > 0.99
    assert np.mean(same) < 0.99


def test_a_false_contact_is_grey_and_has_no_force(model: ObjectModel, tmp_path: Path) -> None:
    reds = []
    for inlier in (None, np.array([0.9, 0.9, 0.1]), np.array([0.1, 0.1, 0.1])):
        shown = ShownHypothesis(RigidTransform(), inlier_probability=inlier)
        scene = Scene(model=model, contacts=TOUCH, hypotheses=(shown,))
        reds.append(share(draw(tmp_path / "picture.png", scene), CONTACT.colour))
    assert reds[0] > 1.3 * reds[1] > 0.0
    assert reds[2] == 0.0


def test_an_estimate_brings_its_own_scene(model: ObjectModel, tmp_path: Path) -> None:
    estimate = estimate_pose(model, TOUCH, prior=PosePrior(X_off))
    save_picture(tmp_path / "picture.png", estimate)
    left, right = np.split(imread(tmp_path / "picture.png")[..., :3], 2, axis=1)
    assert share(left, PRIOR.colour) > 0.1
    assert share(right, ESTIMATE.colour) > 0.1


def test_a_long_object_is_not_seen_along_its_axis(tmp_path: Path) -> None:
    can = ObjectModel.from_mesh(trimesh.creation.cylinder(radius=0.033, height=0.12, sections=32), cache=False)
    for axis in np.eye(3)[:2]:
        X_PO = RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), np.zeros(3))
        view = choose_view(Scene(model=can, contacts=Contacts.empty(), hypotheses=(ShownHypothesis(X_PO),)))
        assert abs(view @ axis) < 0.5


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_contacts_are_on_the_side_that_is_seen(model: ObjectModel, side: float) -> None:
    n_PC = np.tile([side, 0.0, 0.0], (3, 1))
    touch = Contacts([[0.03 * side, 0, 0], [0.03 * side, 0.02, 0], [0.03 * side, 0, 0.03]], n_PC)
    view = choose_view(Scene(model=model, contacts=touch, hypotheses=(ShownHypothesis(RigidTransform()),)))
    assert view[0] * side > 0.1


def test_frames_and_friction_cones_are_drawn_on_request(model: ObjectModel, tmp_path: Path) -> None:
    bare = Scene(model=model, contacts=Contacts(TOUCH.p_PC, TOUCH.n_PC), hypotheses=(ShownHypothesis(X_off),))
    without = draw(tmp_path / "picture.png", bare)
    framed = draw(tmp_path / "picture.png", dataclasses.replace(bare, frames=True))
    green = AXIS_COLOURS[1]
    assert share(without, green) == 0.0
    assert share(framed, green) > 0.0005
    coned = draw(tmp_path / "picture.png", dataclasses.replace(bare, friction=0.8))
    assert np.mean(np.abs(without[60:-90] - coned[60:-90]).max(axis=2) > 0.06) > 0.002


def test_numbers_of_near_contacts_do_not_cover_each_other(model: ObjectModel, tmp_path: Path) -> None:
    inks = []
    for gap in (0.0, 0.04):
        touch = Contacts([[0.03, 0.0, 0.0], [0.03, gap, 0.0]], [[1.0, 0.0, 0.0]] * 2)
        image = draw(
            tmp_path / "picture.png",
            Scene(model=model, contacts=touch, hypotheses=(ShownHypothesis(RigidTransform()),)),
        )
        # What is written is white around dark red letters.
        inks.append(np.count_nonzero(np.all(image[60:-90, 150:-150] > 0.995, axis=2)))
    assert inks[0] > 0.7 * inks[1] > 0


def test_regions_are_in_the_picture_whole(model: ObjectModel) -> None:
    wide = ShownHypothesis(RigidTransform(), covariance=np.diag(np.square([1e-4] * 3 + [1e-4, 1e-4, 0.01])))
    points = points_of_interest(Scene(model=model, contacts=Contacts.empty(), hypotheses=(wide,)))
    # Half of the box, and 2.8 standard deviations of its corners.
    assert points.max(axis=0) == pytest.approx([0.03, 0.04, 0.05 + 2.796 * 0.01], abs=1e-3)
    assert points.min(axis=0) == pytest.approx([-0.03, -0.04, -0.05 - 2.796 * 0.01], abs=1e-3)
