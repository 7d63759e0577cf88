import json
import math

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import touch_with_pads
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidInputError, UnknownNameError
from tests.core.meshes import random_pose, shape_poor_in_symmetry

MESHES = {
    "block": shape_poor_in_symmetry(),
    "box": trimesh.creation.box((0.1, 0.06, 0.04)),
    "can": trimesh.creation.cylinder(0.033, 0.11, sections=48),
    "ball": trimesh.creation.icosphere(4, 0.035),
    "cone": trimesh.creation.cone(0.04, 0.1, sections=48),
    "ring": trimesh.creation.torus(0.045, 0.012, 48, 24),
    "tile": trimesh.creation.box((0.11, 0.11, 0.012)),
}


@pytest.fixture(scope="module")
def models() -> dict[str, ObjectModel]:
    return {
        name: ObjectModel.from_mesh(mesh, name=name, samples=600, spacing=0.0015, cache=False)
        for name, mesh in MESHES.items()
    }


def touch(model: ObjectModel, seed: int, count: int) -> Contacts:
    generator = np.random.default_rng(seed)
    return touch_surface(model, random_pose(generator)[:3], count, generator)


def others(models: dict[str, ObjectModel], name: str) -> list[ObjectModel]:
    return [model for other, model in models.items() if other != name]


@pytest.mark.parametrize("name", ["block", "ring", "can"])
def test_what_is_known_is_said_to_be_and_what_is_not_is_not(models: dict[str, ObjectModel], name: str) -> None:
    contacts = touch(models[name], 1, 8)
    among = tp.identify(list(models.values()), contacts)
    assert (among.best.name, among.status) == (name, "ok")
    assert among.unknown < 0.1
    without = tp.identify(others(models, name), contacts)
    assert without.status == "no_solution"
    assert without.unknown > 0.9


@pytest.mark.parametrize(("sigma_position", "sigma_normal", "least"), [(1e-4, 0.5, 0.9), (0.005, 20.0, 0.05)])
def test_how_precise_a_touch_is_counts(
    models: dict[str, ObjectModel], sigma_position: float, sigma_normal: float, least: float
) -> None:
    """A precise touch tells an unknown object; a rough one is no proof that a known object is none."""
    noise = {"sigma_position": sigma_position, "sigma_normal": math.radians(sigma_normal)}
    for name in ("block", "can"):
        contacts = touch_surface(models[name], np.eye(3, 4), 8, np.random.default_rng(1), **noise)
        assert tp.identify(list(models.values()), contacts).unknown < 0.9
        assert tp.identify(others(models, name), contacts).unknown > least


def test_the_only_known_object_may_not_be_it(models: dict[str, ObjectModel]) -> None:
    contacts = touch(models["block"], 2, 8)
    assert tp.identify([models["block"]], contacts).unknown < 0.1
    other = tp.identify([models["ball"]], contacts)
    assert other.best.likelihood == 1.0
    assert other.unknown > 0.9
    assert other.best.probability == pytest.approx(1.0 - other.unknown)


def test_it_is_as_often_unknown_as_is_said(models: dict[str, ObjectModel]) -> None:
    said, true, names = [], [], []
    for seed in range(2):
        for name in models:
            contacts = touch(models[name], 100 + seed, 5)
            # Two of three touches are of a known object.
            for among in (list(models.values()), list(models.values()), others(models, name)):
                found = tp.identify(among, contacts)
                said.append(found.unknown)
                true.append(len(among) < len(models))
                if found.best.probability > 0.95:
                    names.append(found.best.name == name)
    spread = math.sqrt(sum(p * (1.0 - p) for p in said))
    # Both of known objects are of one touch: their errors are the same.
    assert abs(sum(said) - sum(true)) < 3.0 * math.sqrt(2.0) * spread
    likely, unlikely = np.array(true)[np.array(said) > 0.5], np.array(true)[np.array(said) < 0.2]
    assert likely.mean() > 0.6
    assert unlikely.mean() < 0.25
    assert len(names) > 10
    assert np.mean(names) > 0.93


@pytest.mark.parametrize(("count", "has_normals"), [(2, True), (3, True), (5, False), (8, False)])
def test_few_contacts_and_points_without_normals_are_no_proof_of_a_known_object(
    models: dict[str, ObjectModel], count: int, has_normals: bool
) -> None:
    known, unknown = [], []
    for seed in range(3):
        for name in models:
            contacts = touch(models[name], 200 + seed, count)
            contacts = contacts if has_normals else Contacts(contacts.p_PC)
            known.append(tp.identify(list(models.values()), contacts).unknown)
            unknown.append(tp.identify(others(models, name), contacts).unknown)
    # Two of three touches are of a known object.
    assert (2.0 * np.mean(known) + np.mean(unknown)) / 3.0 == pytest.approx(1.0 / 3.0, abs=0.1)
    assert np.mean(unknown) > np.mean(known)


def test_one_contact_tells_nothing_of_the_shape(models: dict[str, ObjectModel]) -> None:
    for name in ("block", "ball"):
        for seed in range(3):
            found = tp.identify(list(models.values()), touch(models[name], seed, 1))
            assert found.unknown == pytest.approx(1 / 3)
            assert found.status != "ok"


def test_pads_tell_it_too(models: dict[str, ObjectModel]) -> None:
    generator = np.random.default_rng(9)
    patches = touch_with_pads(models["block"], random_pose(generator)[:3], 5, generator)
    known = tp.identify(list(models.values()), Contacts.empty(), patches).unknown
    assert known < 0.2
    assert tp.identify(others(models, "block"), Contacts.empty(), patches).unknown > known + 0.3


def test_a_prior_of_none_rules_it_out_and_names_are_given_only_with_certainty(models: dict[str, ObjectModel]) -> None:
    contacts = touch(models["block"], 4, 4)
    certain = tp.identify(others(models, "block"), contacts, unknown_prior=0.0)
    assert certain.unknown == 0.0
    assert [identity.probability for identity in certain] == [identity.likelihood for identity in certain]
    for prior in (0.0, 0.2, 0.6, 0.95):
        found = tp.identify(list(models.values()), contacts, unknown_prior=prior)
        if found.status == "ok":
            assert found.best.probability >= 0.9
        assert found.status != "ok" or found.unknown <= 0.1
    assert found.unknown > 0.1  # What was so probable before is not made improbable by four contacts.
    assert found.status != "ok"


def test_an_identification_is_plain_data(models: dict[str, ObjectModel]) -> None:
    found = tp.identify(list(models.values()), touch(models["can"], 5, 4))
    again = tp.Identification.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again == found
    assert again.unknown == found.unknown
    assert hash(again) == hash(found)
    with pytest.raises(
        UnknownNameError, match=r"^Identification\.from_dict: a key must be one of identities, .*, not 'known'"
    ):
        tp.Identification.from_dict({**found.to_dict(), "known": 1.0})
    with pytest.raises(
        InvalidInputError, match=r"^Identification\.from_dict: identities must be at least one, not none"
    ):
        tp.Identification.from_dict({"status": "ok", "duration": 1.0, "unknown": 0.5})
