import dataclasses

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, ContactResults, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import AddRandomInputs

from tactopose_drake.core.sensing.rubber_layer import RubberLayer
from tactopose_drake.core.sensing.tactile_array import TactileModel
from tactopose_drake.core.sensing.tactile_patterns import CellRow, RowPattern
from tactopose_drake.errors import InvalidInputError, PortTypeError
from tactopose_drake.hand.tactile_pads import TactilePad
from tactopose_drake.systems.random_sources import seed_random_sources
from tactopose_drake.systems.simulated_array import TactileArray

MASS, THICKNESS, MODULUS = 0.8, 0.006, 2e5
# T lies in the middle of the pad's upper face, turned: its z is up, its x the world's y.
X_WT = RigidTransform(RollPitchYaw(0, 0, np.pi / 2), [0.1, -0.2, 0.3])
X_PadT = RigidTransform(RollPitchYaw(0, 0, np.pi), [0.005, -0.003, THICKNESS / 2])


def make_pad(**limits) -> TactilePad:
    x = 0.002 * (np.arange(20) - 9.5)
    rows = [CellRow(center=[float(at), 0, 0], count=20, cell=[0.002, 0.002]) for at in x]
    return TactilePad(RowPattern(pitch=0.002, rows=rows).make(), TactileModel(**limits), period=0.01)


def friction() -> CoulombFriction:
    return CoulombFriction(0.9, 0.9)


def rest_on_pad(
    pad: TactilePad, p_TO=(0.004, -0.002), *, order="pad first", shape=None, seed=None, beside=False, **plant_config
) -> tuple[np.ndarray, str]:
    """A body that rests on a soft pad, let go just above; the array's reading after 0.6 s.

    With `beside`, a ball that says nothing of compliance lies in the pad's corner, too.
    """
    shape = Box(0.02, 0.016, 0.02) if shape is None else shape
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.005, **{"contact_model": "hydroelastic"} | plant_config)
    plant, _ = AddMultibodyPlant(config, builder)
    bodies = {}
    for name in ("pad", "object") if order == "pad first" else ("object", "pad"):
        bodies[name] = plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(MASS, 0.01))
        properties = ProximityProperties()
        AddContactMaterial(dissipation=5.0, friction=friction(), properties=properties)
        if name == "pad":
            AddCompliantHydroelasticProperties(0.01, MODULUS, properties)
            X_WPad = X_WT @ X_PadT.inverse()
            plant.RegisterCollisionGeometry(
                bodies[name], RigidTransform(), Box(0.06, 0.06, THICKNESS), "pad", properties
            )
            plant.WeldFrames(plant.world_frame(), bodies[name].body_frame(), X_WPad)
        else:
            AddRigidHydroelasticProperties(0.005, properties)
            plant.RegisterCollisionGeometry(bodies[name], RigidTransform(), shape, "object", properties)
    if beside:
        ball = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(0.001, 0.001))
        plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(0.001), "ball", friction())
        plant.SetDefaultFloatingBaseBodyPose(ball, X_WT @ RigidTransform([-0.025, -0.025, 0.001]))
    frame = plant.AddFrame(FixedOffsetFrame("T", bodies["pad"].body_frame(), X_PadT))
    plant.Finalize()
    array = builder.AddNamedSystem("array", TactileArray(plant, frame, pad))
    builder.Connect(plant.get_contact_results_output_port(), array.GetInputPort("contact_results"))
    builder.Connect(plant.get_body_poses_output_port(), array.GetInputPort("body_poses"))
    if seed is not None:
        AddRandomInputs(pad.period, builder)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    if seed is not None:
        assert seed_random_sources(diagram, context, seed) == 1
    height = shape.depth() / 2 if isinstance(shape, Box) else shape.radius()
    X_WO = X_WT @ RigidTransform([*p_TO, height - 5e-5])
    plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), bodies["object"], X_WO)
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(0.6)
    array_context = array.GetMyContextFromRoot(context)
    return array.GetOutputPort("pressures").Eval(array_context), array.GetOutputPort("status").Eval(array_context)


@pytest.mark.parametrize("order", ["pad first", "object first"])
@pytest.mark.parametrize("representation", ["polygon", "triangle"])
def test_the_pressure_on_all_cells_carries_the_weight(order: str, representation: str) -> None:
    pad = make_pad()
    pressures, status = rest_on_pad(pad, order=order, contact_surface_representation=representation)
    assert status == "ok"
    assert pressures @ pad.layout.areas == pytest.approx(MASS * 9.81, rel=2e-3)
    center = (pressures * pad.layout.areas) @ pad.layout.p_TC / (pressures @ pad.layout.areas)
    np.testing.assert_allclose(center, [0.004, -0.002, 0.0], atol=2e-5)
    # The box's edges are the cells': those below it share the weight evenly, the others feel nothing.
    under = np.all(np.abs(pad.layout.p_TC[:, :2] - [0.004, -0.002]) < [0.01, 0.008], axis=1)
    assert under.sum() == 80
    np.testing.assert_allclose(pressures[under], MASS * 9.81 / (0.02 * 0.016), rtol=0.02)
    assert np.all(pressures[~under] < 0.02 * pressures.max())


def test_a_soft_layer_reaches_further_and_carries_the_same() -> None:
    hard, soft = make_pad(), make_pad(spread=0.002)
    readings = [rest_on_pad(pad)[0] for pad in (hard, soft)]
    assert readings[0].sum() == pytest.approx(readings[1].sum())
    assert np.count_nonzero(readings[1] > 100) > np.count_nonzero(readings[0] > 100)


def test_rubber_that_keeps_its_volume_carries_the_same_in_a_dome() -> None:
    pad = make_pad(rubber=RubberLayer(confinement=1.0))
    pressures, _ = rest_on_pad(pad)
    assert pressures @ pad.layout.areas == pytest.approx(MASS * 9.81, rel=2e-3)
    under = np.all(np.abs(pad.layout.p_TC[:, :2] - [0.004, -0.002]) < [0.01, 0.008], axis=1)
    assert pressures.max() > 1.8 * pressures[under].mean()
    middle = np.abs(pad.layout.p_TC[pressures.argmax(), :2] - [0.004, -0.002])
    assert np.all(middle < 0.002)


def test_cells_that_lag_read_more_after_a_fall() -> None:
    plain, lagging = (rest_on_pad(make_pad(rubber=RubberLayer(hysteresis=h)))[0] for h in (0.0, 0.2))
    assert np.all(lagging >= plain)
    assert lagging.sum() > 1.01 * plain.sum()


def test_a_cell_that_is_let_go_forgets_how_hard_it_was_pressed() -> None:
    """Pressed lightly after a heavy press, it lags; after a heavy press and none, it reads as when first pressed."""
    pad = make_pad(rubber=RubberLayer(hysteresis=0.2))
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.005, contact_model="hydroelastic", use_sampled_output_ports=False)
    plant, _ = AddMultibodyPlant(config, builder)
    bodies = [plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(MASS, 0.01)) for name in ("pad", "object")]
    soft, rigid = ProximityProperties(), ProximityProperties()
    AddCompliantHydroelasticProperties(0.01, MODULUS, soft)
    AddRigidHydroelasticProperties(0.005, rigid)
    for properties in (soft, rigid):
        AddContactMaterial(dissipation=0.0, friction=friction(), properties=properties)
    plant.RegisterCollisionGeometry(bodies[0], RigidTransform(), Box(0.06, 0.06, THICKNESS), "pad", soft)
    plant.RegisterCollisionGeometry(bodies[1], RigidTransform(), Box(0.02, 0.016, 0.02), "object", rigid)
    plant.WeldFrames(plant.world_frame(), bodies[0].body_frame(), X_WT @ X_PadT.inverse())
    frame = plant.AddFrame(FixedOffsetFrame("T", bodies[0].body_frame(), X_PadT))
    plant.Finalize()
    array, diagram = TactileArray(plant, frame, pad), builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)

    def read(*depths: float) -> np.ndarray:
        """What is read last of an object that is held so deep in the pad, one period each, m."""
        simulator = Simulator(array)
        for i, depth in enumerate(depths):
            plant.SetFreeBodyPose(plant_context, bodies[1], X_WT @ RigidTransform([0.0, 0.0, 0.01 - depth]))
            for name in ("contact_results", "body_poses"):
                value = plant.GetOutputPort(name).Eval(plant_context)
                array.GetInputPort(name).FixValue(simulator.get_mutable_context(), AbstractValue.Make(value))
            simulator.AdvanceTo((i + 1.5) * pad.period)
        return array.GetOutputPort("pressures").Eval(simulator.get_context())

    light, heavy = 0.0001, 0.0004
    first, lagging, anew = read(light), read(heavy, light), read(heavy, -0.001, light)
    assert first.max() > 1000.0
    assert lagging.sum() > 1.1 * first.sum()
    np.testing.assert_array_equal(anew, first)


def test_noise_is_the_seeds_and_a_dead_cell_is_nan() -> None:
    pad = make_pad(noise=50.0, dead_cells=[7])
    first, again, other = (rest_on_pad(pad, seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other, equal_nan=True)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(first)), [7])


def test_a_saturated_cell_is_named() -> None:
    pressures, status = rest_on_pad(make_pad(range=3000.0))
    assert status == "saturated: " + ", ".join(str(i) for i in np.flatnonzero(pressures == 3000.0))
    assert pressures.max() == 3000.0


def test_nothing_on_the_pad_is_no_contact() -> None:
    pressures, status = rest_on_pad(make_pad(), p_TO=(0.2, 0.0))
    assert status == "no contact"
    assert not pressures.any()


def test_of_a_point_contact_no_pressure_is_known_and_that_is_said() -> None:
    pressures, status = rest_on_pad(make_pad(), shape=Sphere(0.01), contact_model="point")
    assert status == "a point contact is not felt"
    assert np.isnan(pressures).all(), "zero would say that nothing is there"


def test_beside_a_point_contact_what_is_felt_still_is() -> None:
    felt, _ = rest_on_pad(make_pad())
    pressures, status = rest_on_pad(make_pad(), beside=True, contact_model="hydroelastic_with_fallback")
    assert status == "ok; a point contact is not felt"
    np.testing.assert_allclose(pressures[felt > 0.0], felt[felt > 0.0], rtol=1e-3)
    assert np.isnan(pressures[felt == 0.0]).all()


def test_there_is_no_reading_before_the_first_sample() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.001), builder)
    body = plant.AddRigidBody("pad", SpatialInertia.SolidSphereWithMass(1.0, 0.01))
    plant.RegisterCollisionGeometry(body, RigidTransform(), Sphere(0.01), "pad", friction())
    bare = plant.AddRigidBody("bare", SpatialInertia.SolidSphereWithMass(1.0, 0.01))
    plant.Finalize()
    array = TactileArray(plant, body.body_frame(), make_pad())
    array.set_name("array")
    context = array.CreateDefaultContext()
    assert np.all(np.isnan(array.GetOutputPort("pressures").Eval(context)))
    assert array.GetOutputPort("status").Eval(context) == "no sample yet"
    array.GetInputPort("contact_results").FixValue(context, ContactResults())
    simulator = Simulator(array, context)
    with pytest.raises(PortTypeError, match="'body_poses' of system 'array'"):
        simulator.AdvanceTo(0.02)
    with pytest.raises(
        InvalidInputError,
        match=r"must be a frame of a body with collision geometry to be touched .*, whose body 'bare' has none",
    ):
        TactileArray(plant, bare.body_frame(), make_pad())
    with pytest.raises(InvalidInputError, match=r"dead_cells must be .*, not 400"):
        TactileArray(plant, body.body_frame(), dataclasses.replace(make_pad(), model=TactileModel(dead_cells=[400])))
