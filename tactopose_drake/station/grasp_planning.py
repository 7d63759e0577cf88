"""Plans the grasps of a scenario."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.grasping.grasp_plan import GraspPlan, Refusals
from tactopose_drake.core.grasping.grasp_planner import plan_grasps
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import instance_of
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.hand_reach import check_rest_positions, make_hand_reach
from tactopose_drake.hand.self_collision import SelfCollision
from tactopose_drake.resources import add_model, fixed_pose, make_parser
from tactopose_drake.station.scenario import Scenario


def plan_scenario(scenario: Scenario, model: ObjectModel | None = None) -> list[GraspPlan]:
    """Plans grasps of a scenario's object, by falling score, with the scenario's seed.

    Raises:
        InvalidInputError: if no grasp is found, or a joint's rest position is beyond its limits.
    """
    instance_of("scenario", scenario, Scenario)
    instance_of("model", model, ObjectModel, type(None))
    scenario.validate()
    config = load_hand_config(scenario.hand)
    model = scenario.object_model() if model is None else model
    plant, hand = make_hand_plant(config)
    check_rest_positions(plant, hand)
    context = plant.CreateDefaultContext()
    X_BaseP = plant.CalcRelativeTransform(
        context, plant.GetFrameByName(config.base_link, hand.model_instance), hand.palm_frame
    )
    R_WP = fixed_pose("Scenario.X_WBase", scenario.X_WBase).rotation() @ X_BaseP.rotation()
    load_P = R_WP.inverse() @ (_object_mass(scenario) * plant.gravity_field().gravity_vector())
    reach = make_hand_reach(config, scenario.reach)
    refusals = Refusals()
    generator, touches_itself = np.random.default_rng(scenario.seed), SelfCollision(config)
    plans = plan_grasps(model, reach, load_P, scenario.planner, generator, refusals, touches_itself)
    if not plans:
        raise InvalidInputError(
            f"Scenario.object must fit between the hand's fingers, but the hand {scenario.hand!r} finds no way to hold "
            f"{model.name!r}, {refusals.explanation()}.{_finger_advice(scenario, len(reach.fingers))}"
            f"{grip_advice(scenario)}"
        )
    return plans


def grip_advice(scenario: Scenario) -> str:
    """Advice for when planned grasps do not hold; empty if the hand's file gives a grip region."""
    if scenario.grip is not None or load_hand_config(scenario.hand).grip_low:
        return ""
    return (
        " The hand's grip region was found from its model, see `tactopose check-hand`; grip_low and grip_high in its "
        "file set another one."
    )


def _finger_advice(scenario: Scenario, fingers: int) -> str:
    """Advice for when no grasp is planned; empty if two fingers are enough."""
    least = min(scenario.planner.least_fingers, fingers)
    if least <= 2:
        return ""
    return f" At least {least} fingers must touch it; `planner: {{least_fingers: 2}}` in a scenario lets two hold it."


def _object_mass(scenario: Scenario) -> float:
    """Mass of the object, kg, from its SDF."""
    plant = MultibodyPlant(time_step=0.0)
    instance = add_model(make_parser(plant), scenario.object_sdf())
    plant.Finalize()
    return float(plant.CalcTotalMass(plant.CreateDefaultContext(), [instance]))
