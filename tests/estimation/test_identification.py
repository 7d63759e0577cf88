import math
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import transform_points
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_patch import touch_with_pads
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidInputError, TooFewContactsError, UnknownNameError
from tactopose_drake.estimation.identities import Identification
from tactopose_drake.estimation.inference import weigh_poses
from tactopose_drake.estimation.object_library import ObjectLibrary
from tests.core.meshes import random_pose, shape_poor_in_symmetry

MESHES = {
    "block": shape_poor_in_symmetry(),
    "box": trimesh.creation.box((0.1, 0.06, 0.04)),
    "can": trimesh.creation.cylinder(0.033, 0.11, sections=48),
    "ball": trimesh.creation.icosphere(4, 0.035),
    "cone": trimesh.creation.cone(0.04, 0.1, sections=48),
}


def make(name: str, mesh: trimesh.Trimesh) -> ObjectModel:
    return ObjectModel.from_mesh(mesh, name=name, samples=600, spacing=0.0015, cache=False)


@pytest.fixture(scope="module")
def models() -> list[ObjectModel]:
    return [make(name, mesh) for name, mesh in MESHES.items()]


@pytest.fixture(scope="module")
def twin() -> ObjectModel:
    """The block in another place of its frame, by a finer mesh."""
    return make("twin", shape_poor_in_symmetry().subdivide().apply_transform(random_pose(np.random.default_rng(0))))


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObjectLibrary]:
    folder = tmp_path_factory.mktemp("library")
    for name, mesh in MESHES.items():
        mesh.export(folder / f"{name}.stl")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTOPOSE_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield ObjectLibrary.open(folder)


def touch(model: ObjectModel, seed: int, count: int = 6) -> Contacts:
    generator = np.random.default_rng(seed)
    return touch_surface(model, random_pose(generator)[:3], count, generator)


def facts(found: Identification) -> list[tuple[object, ...]]:
    """All that should not depend on who computes it, by name."""
    return sorted(
        (
            identity.name,
            identity.rank,
            identity.likelihood,
            identity.probability,
            identity.log_evidence,
            None if identity.estimate is None else identity.estimate.best.X_PO.GetAsMatrix34().tobytes(),
        )
        for identity in found
    )


def test_the_touched_object_is_first(models: list[ObjectModel]) -> None:
    right = 0
    for seed, model in enumerate(models * 3):
        found = tp.identify(models, touch(model, seed))
        right += found.best.name == model.name
        assert found.best is found[0]
        assert [identity.rank for identity in found] == [1, 2, 3, 4, 5]
        assert np.all(np.diff([identity.likelihood for identity in found]) <= 0.0)
        assert math.fsum(identity.likelihood for identity in found) == pytest.approx(1.0)
        assert math.fsum(identity.probability for identity in found) + found.unknown == pytest.approx(1.0)
        assert [models[identity.index].name for identity in found] == [identity.name for identity in found]
    assert right >= 13


def test_likelihoods_are_the_shares_of_the_evidence(models: list[ObjectModel]) -> None:
    contacts = touch(models[1], 1, count=4)
    found = tp.identify(models, contacts)
    # Not `tp.estimate_pose`'s, which doubts contacts more.
    estimates = [weigh_poses(model, Evidence(contacts), "pair_search", 0, 16, math.inf) for model in models]
    evidence = {model.name: estimate.log_evidence for model, estimate in zip(models, estimates, strict=True)}
    for a in found:
        assert a.log_evidence == evidence[a.name]
        if a.likelihood > 0.0:
            ratio = math.exp(evidence[a.name] - evidence[found.best.name])
            assert a.likelihood / found.best.likelihood == pytest.approx(ratio)


def test_the_thesis_measure_is_the_inverse_of_the_lowest_cost(models: list[ObjectModel]) -> None:
    contacts = touch(models[0], 2)
    found = tp.identify(models, contacts, likelihood="inverse_cost")
    lowest = {}
    for identity in found:
        assert identity.estimate is not None
        lowest[identity.name] = min(hypothesis.cost for hypothesis in identity.estimate.hypotheses)
    total = sum(1.0 / cost for cost in lowest.values())
    for identity in found:
        assert identity.likelihood == pytest.approx(1.0 / lowest[identity.name] / total)
    assert found.best.name == min(lowest, key=lowest.__getitem__)


def test_equal_shapes_are_ties(models: list[ObjectModel], twin: ObjectModel) -> None:
    found = tp.identify([*models, twin], touch(models[0], 3))
    assert [{identity.name for identity in group} for group in found.ties] == [{"block", "twin"}]
    first, second, third = found[:3]
    assert {first.name, second.name} == {"block", "twin"}
    assert (first.rank, second.rank, third.rank) == (1, 1, 3)
    assert first.likelihood == second.likelihood
    assert found.status == "ok"  # Neither has as much by itself.
    assert first.likelihood <= 0.5
    assert not tp.identify(models, touch(models[0], 3)).ties


def test_the_order_of_the_objects_changes_nothing(models: list[ObjectModel], twin: ObjectModel) -> None:
    contacts, several = touch(models[0], 4), [*models, twin]
    found = tp.identify(several, contacts)
    for order in ([5, 4, 3, 2, 1, 0], [3, 5, 0, 2, 1, 4]):
        again = tp.identify([several[i] for i in order], contacts)
        assert facts(again) == facts(found)
        assert [identity.name for identity in again] == [identity.name for identity in found]


def test_another_object_never_raises_the_evidence(models: list[ObjectModel], twin: ObjectModel) -> None:
    contacts = touch(models[0], 5)
    before = {identity.name: identity for identity in tp.identify(models, contacts)}
    after = {identity.name: identity for identity in tp.identify([*models, twin], contacts)}
    for name, identity in before.items():
        assert after[name].log_evidence <= identity.log_evidence
    assert after["block"].likelihood <= before["block"].likelihood


def test_the_executor_changes_no_bit(library: ObjectLibrary) -> None:
    contacts = touch(library.objects[0].load(), 6)
    found = facts(tp.identify(library, contacts, candidates=3))
    executors: list[Executor] = [
        ThreadPoolExecutor(2),
        ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")),
    ]
    for executor in executors:
        with executor:
            assert facts(tp.identify(library, contacts, executor=executor, candidates=3)) == found


def test_a_library_names_what_its_models_name(library: ObjectLibrary) -> None:
    models = [known.load() for known in library.objects]
    for i, model in enumerate(models):
        contacts = touch(model, 10 + i)
        assert facts(tp.identify(library, contacts)) == facts(tp.identify(models, contacts))


def test_of_a_library_only_the_candidates_are_estimated(library: ObjectLibrary) -> None:
    for i, known in enumerate(library.objects):
        contacts = touch(known.load(), 20 + i)
        found = tp.identify(library, contacts, candidates=2)
        assert found.best.name == known.name
        assert [identity.estimate is None for identity in found] == [False, False, True, True, True]
        every = {identity.name: identity.log_evidence for identity in tp.identify(library, contacts)}
        for identity in found[:2]:
            assert identity.log_evidence == every[identity.name]
        for identity in found[2:]:
            assert (identity.likelihood, identity.probability, identity.log_evidence) == (0.0, 0.0, -math.inf)
        assert len({identity.index for identity in found}) == len(library)


def test_the_pose_is_that_of_the_touched_object(models: list[ObjectModel]) -> None:
    generator = np.random.default_rng(7)
    X_PO = random_pose(generator)[:3]
    found = tp.identify(models, touch_surface(models[0], X_PO, 8, generator))
    assert found.best.name == "block"
    assert found.best.estimate is not None
    X_hat = found.best.estimate.best.X_PO.GetAsMatrix34()
    vertices = models[0].vertices
    np.testing.assert_allclose(transform_points(X_hat, vertices), transform_points(X_PO, vertices), atol=0.01)


def test_patches_alone_name_the_object(models: list[ObjectModel], library: ObjectLibrary) -> None:
    generator = np.random.default_rng(9)
    patches = touch_with_pads(models[0], random_pose(generator)[:3], 4, generator)
    assert tp.identify(models, Contacts.empty(), patches).best.name == "block"
    assert tp.identify(library, Contacts.empty(), patches, candidates=2).best.name == "block"


def test_what_no_object_explains_is_said(models: list[ObjectModel]) -> None:
    far = Contacts(np.eye(3) * 0.7, np.eye(3))
    assert tp.identify(models, far).status == "no_solution"


@pytest.mark.parametrize("count", [1, 2])
def test_few_contacts_leave_it_open(models: list[ObjectModel], count: int) -> None:
    assert tp.identify(models, touch(models[0], 0, count)).status == "ambiguous"


def test_bad_input_is_named(models: list[ObjectModel], tmp_path: Path) -> None:
    contacts = touch(models[0], 0)
    with pytest.raises(
        InvalidInputError,
        match=r"^models must be an ObjectLibrary, or a sequence of at least one ObjectModel, not \[\]",
    ):
        tp.identify([], contacts)
    with pytest.raises(InvalidInputError, match=r"^models\[1\] must be an ObjectModel, not a str"):
        tp.identify([models[0], "mug.obj"], contacts)  # type: ignore[list-item]
    with pytest.raises(TooFewContactsError, match=r"^contacts must be at least 1 .*, not 0"):
        tp.identify(models, Contacts.empty())
    with pytest.raises(UnknownNameError, match=r"^likelihood must be one of evidence, inverse_cost.*, not 'cost'"):
        tp.identify(models, contacts, likelihood="cost")  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=r"^seed must be an integer >= 0, not -1"):
        tp.identify(models, contacts, seed=-1)
    with ThreadPoolExecutor(1) as executor:
        pass
    with pytest.raises(InvalidInputError, match=r"^executor must be open, but takes no work"):
        tp.identify(models, touch(models[0], 0), executor=executor)
    with pytest.raises(InvalidInputError, match=r"^candidates must be an integer >= 1, not 0"):
        tp.identify(models, contacts, candidates=0)
    for prior, said in [(-0.1, "not -0.1"), (1.0, "must be a number >= 0 and < 1, not 1"), (math.nan, "not nan")]:
        with pytest.raises(InvalidInputError, match=rf"^unknown_prior .*{said}"):
            tp.identify(models, contacts, unknown_prior=prior)
