import numpy as np
import pytest
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

import tactopose_drake as tp
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidInputError, PortTypeError, UnknownNameError
from tactopose_drake.systems.likelihood_display import LikelihoodDisplay, LikelihoodDisplayParams
from tactopose_drake.systems.object_identifier import ObjectIdentifier, ObjectIdentifierParams
from tactopose_drake.visualization.likelihood_bars import HEIGHT, LENGTH, row_path
from tests.core.meshes import random_pose, shape_poor_in_symmetry
from tests.recording_meshcat import RecordingMeshcat

PATH = "/tactopose_identity"
PERIOD = 0.5


@pytest.fixture(scope="module")
def models() -> list[ObjectModel]:
    meshes = {"box": trimesh.creation.box((0.1, 0.06, 0.04)), "a block": shape_poor_in_symmetry()}
    return [ObjectModel.from_mesh(mesh, name=name, spacing=0.002, cache=False) for name, mesh in meshes.items()]


@pytest.fixture(scope="module")
def contacts(models: list[ObjectModel]) -> Contacts:
    generator = np.random.default_rng(0)
    return touch_surface(models[1], random_pose(generator)[:3], 6, generator)


def start(system: ObjectIdentifier, contacts: object) -> Simulator:
    simulator = Simulator(system)
    system.GetInputPort("contacts").FixValue(simulator.get_mutable_context(), AbstractValue.Make(contacts))
    simulator.Initialize()
    return simulator


def output(simulator: Simulator, name: str) -> object:
    system = simulator.get_system()
    return system.GetOutputPort(name).Eval(simulator.get_context())


def test_whoever_makes_one_has_its_objects_ready(models: list[ObjectModel]) -> None:
    """The first touch would wait, in a control loop, for what is made of each."""
    mesh = trimesh.creation.box((0.1, 0.06, 0.05))
    fresh = ObjectModel.from_mesh(mesh, spacing=0.002, cache=False)
    ObjectIdentifier([models[0], fresh])
    assert {"pair_features", "unevenness", "symmetry_turns"} <= vars(fresh).keys()


def test_it_says_what_identify_says(models: list[ObjectModel], contacts: Contacts) -> None:
    simulator = start(ObjectIdentifier(models, ObjectIdentifierParams(period=PERIOD)), contacts)
    simulator.AdvanceTo(0.1)
    found, expected = output(simulator, "identities"), tp.identify(models, contacts)
    assert isinstance(found, tp.Identification)
    assert [(i.name, i.likelihood, i.log_evidence) for i in found] == [
        (i.name, i.likelihood, i.log_evidence) for i in expected
    ]
    assert found.best.name == "a block"
    assert found.unknown == expected.unknown
    assert 0.0 < found.unknown < 0.1
    assert output(simulator, "status") == "ok"


def test_it_holds_while_the_touch_is_too_little(models: list[ObjectModel], contacts: Contacts) -> None:
    simulator = start(ObjectIdentifier(models, ObjectIdentifierParams(period=PERIOD)), Contacts.empty())
    simulator.AdvanceTo(0.1)
    assert output(simulator, "identities") is None
    assert output(simulator, "status") == "held: 0 touches; 3 are needed"
    port = simulator.get_system().GetInputPort("contacts")
    port.FixValue(simulator.get_mutable_context(), AbstractValue.Make(contacts))
    simulator.AdvanceTo(PERIOD - 0.01)
    assert output(simulator, "identities") is None  # Its period is not over yet.
    simulator.AdvanceTo(PERIOD + 0.01)
    held = output(simulator, "identities")
    assert isinstance(held, tp.Identification)
    port.FixValue(simulator.get_mutable_context(), AbstractValue.Make(Contacts.empty()))
    simulator.AdvanceTo(2 * PERIOD + 0.01)
    after = output(simulator, "identities")
    assert isinstance(after, tp.Identification)
    assert after.best.likelihood == held.best.likelihood
    assert str(output(simulator, "status")).startswith("held: ")


def test_the_measure_is_a_parameter(models: list[ObjectModel], contacts: Contacts) -> None:
    params = ObjectIdentifierParams(likelihood="inverse_cost")
    simulator = start(ObjectIdentifier(models, params), contacts)
    simulator.AdvanceTo(0.1)
    found = output(simulator, "identities")
    assert isinstance(found, tp.Identification)
    assert found.best.likelihood == tp.identify(models, contacts, likelihood="inverse_cost").best.likelihood


def test_how_often_objects_are_unknown_is_a_parameter(models: list[ObjectModel], contacts: Contacts) -> None:
    simulator = start(ObjectIdentifier(models, ObjectIdentifierParams(unknown_prior=0.9)), contacts)
    simulator.AdvanceTo(0.1)
    found = output(simulator, "identities")
    assert isinstance(found, tp.Identification)
    assert found.unknown == tp.identify(models, contacts, unknown_prior=0.9).unknown
    assert found.unknown > tp.identify(models, contacts).unknown


def test_bad_parameters_and_inputs_are_named(models: list[ObjectModel]) -> None:
    for params, error, said in [
        (ObjectIdentifierParams(period=0.0), InvalidInputError, "ObjectIdentifierParams.period must be .*, not 0"),
        (
            ObjectIdentifierParams(min_contacts=0),
            InvalidInputError,
            "ObjectIdentifierParams.min_contacts must be .*, not 0",
        ),
        (
            ObjectIdentifierParams(unknown_prior=1.0),
            InvalidInputError,
            "ObjectIdentifierParams.unknown_prior must be .*, not 1",
        ),
        (
            ObjectIdentifierParams(likelihood="cost"),
            UnknownNameError,
            "ObjectIdentifierParams.likelihood must be one of .*, not 'cost'",
        ),
    ]:
        with pytest.raises(error, match=said):
            ObjectIdentifier(models, params)
    simulator = Simulator(ObjectIdentifier(models))
    with pytest.raises(PortTypeError, match="input port 'contacts'"):
        simulator.AdvanceTo(0.1)
    with pytest.raises(InvalidInputError, match=r"period must be .*, not -1"):
        LikelihoodDisplay(RecordingMeshcat(), models, params=LikelihoodDisplayParams(period=-1.0))
    with pytest.raises(InvalidInputError, match="models must have 1 or more objects, not 0"):
        LikelihoodDisplay(RecordingMeshcat(), [])
    with pytest.raises(InvalidInputError, match=r"^meshcat must be a Meshcat, .*, not None"):
        LikelihoodDisplay(None, models)


def test_bars_are_as_long_as_the_likelihoods(models: list[ObjectModel], contacts: Contacts) -> None:
    meshcat, builder = RecordingMeshcat(), DiagramBuilder()
    params = ObjectIdentifierParams(likelihood="inverse_cost", period=PERIOD)
    identifier = builder.AddNamedSystem("identifier", ObjectIdentifier(models, params))
    display = builder.AddNamedSystem("display", LikelihoodDisplay(meshcat, models))
    builder.Connect(identifier.GetOutputPort("identities"), display.GetInputPort("identities"))
    builder.ExportInput(identifier.GetInputPort("contacts"), "contacts")
    simulator = Simulator(builder.Build())
    simulator.get_system().GetInputPort("contacts").FixValue(
        simulator.get_mutable_context(), AbstractValue.Make(contacts)
    )
    simulator.AdvanceTo(0.3)
    likelihood = {i.name: i.likelihood for i in tp.identify(models, contacts, likelihood="inverse_cost")}
    assert min(likelihood.values()) > 0.01
    for row, model in enumerate(models):
        at = row_path(PATH, row, model.name)
        assert f"{at}/shape" in meshcat.objects
        _, length, _ = meshcat.properties[f"{at}/bar/box", "scale"]  # type: ignore[misc]
        assert length == pytest.approx(likelihood[model.name])
        # The bar begins where every bar does, in its own row.
        middle = meshcat.pose(f"{at}/bar").translation()
        np.testing.assert_allclose(middle - [0.0, 0.5 * LENGTH * length, 0.0], [0.0, HEIGHT, -HEIGHT * row], atol=1e-12)
    assert row_path(PATH, 1, "a block") == f"{PATH}/1/a_block"


@pytest.mark.parametrize("count", [1, 2])
def test_the_camera_is_aimed_at_all_bars_where_that_is_asked(models: list[ObjectModel], count: int) -> None:
    meshcat = RecordingMeshcat()
    for aims in (False, True):
        display = LikelihoodDisplay(meshcat, models[:count], LikelihoodDisplayParams(aim_camera=aims))
        simulator = Simulator(display)
        display.GetInputPort("identities").FixValue(simulator.get_mutable_context(), AbstractValue.Make(None))
        simulator.Initialize()
        assert len(meshcat.cameras) == aims
    np.testing.assert_allclose(meshcat.target, [0.0, 0.1625, 0.025 - 0.025 * count], atol=1e-12)
    away = meshcat.camera - meshcat.target
    np.testing.assert_array_equal(away[1:], 0.0)
    # The longest bar and the last row are in the picture, which is 75 degrees high, and as wide at the least.
    assert np.hypot(0.375, 0.05 * count) < 2.0 * away[0] * np.tan(np.radians(37.5)) < 0.6


def test_bars_are_empty_before_the_first_touch(models: list[ObjectModel]) -> None:
    meshcat = RecordingMeshcat()
    display = LikelihoodDisplay(meshcat, models)
    simulator = Simulator(display)
    display.GetInputPort("identities").FixValue(simulator.get_mutable_context(), AbstractValue.Make(None))
    simulator.AdvanceTo(0.01)
    for row, model in enumerate(models):
        assert meshcat.properties[f"{row_path(PATH, row, model.name)}/bar/box", "scale"][1] < 0.01  # type: ignore[index]


def test_bars_need_no_simulation(models: list[ObjectModel]) -> None:
    meshcat = RecordingMeshcat()
    display = LikelihoodDisplay(meshcat, models)
    context = display.CreateDefaultContext()
    display.GetInputPort("identities").FixValue(context, AbstractValue.Make(None))
    display.ForcedPublish(context)
    for row, model in enumerate(models):
        assert f"{row_path(PATH, row, model.name)}/bar/box" in meshcat.objects


def test_what_it_cannot_work_with_is_named_when_it_is_made(models: list[ObjectModel]) -> None:
    for none in ([], 3, models[0]):
        with pytest.raises(InvalidInputError, match=r"^models must be an ObjectLibrary, or a sequence of .*, not"):
            ObjectIdentifier(none)
    with pytest.raises(InvalidInputError, match=r"^models\[1\] must be an ObjectModel, not a str"):
        ObjectIdentifier([models[0], "bust"])
    with pytest.raises(InvalidInputError, match=r"^params must be an ObjectIdentifierParams, not an int"):
        ObjectIdentifier(models, 3)
    with pytest.raises(InvalidInputError, match=r"^executor must be an Executor, not an int"):
        ObjectIdentifier(models, executor=3)
    for change in ({"candidates": 2.5}, {"min_contacts": "3"}, {"seed": -1}):
        ((name, value),) = change.items()
        with pytest.raises(InvalidInputError, match=rf"^ObjectIdentifierParams\.{name} must be an? .*, not {value!r}"):
            ObjectIdentifierParams(**change).validate()
