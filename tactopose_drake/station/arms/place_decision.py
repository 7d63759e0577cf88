"""Puts the decision of handing over and placing into an arm's station."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.grasping.held_axis import HeldAxis
from tactopose_drake.resources import fixed_pose
from tactopose_drake.station.arms.arm_station import ArmParts, ArmSetup
from tactopose_drake.station.arms.carried_hand import CarriedHand
from tactopose_drake.station.arms.place_planning import PlaceParams, PlacePlanner
from tactopose_drake.station.arms.place_task import PlaceTask


def AddPlaceTask(
    builder: DiagramBuilder, parts: ArmParts, setup: ArmSetup, grip: HeldAxis, params: PlaceParams
) -> PlaceTask:
    """Adds a `PlaceTask` named "place_task" that decides by the station's estimation; for `make_arm_station`.

    Args:
        builder: of the station, which has a "grasp_controller".
        parts: of the station.
        setup: it was made by.
        grip: where the hand holds a rod best, in P.
        params: where table and hole are, and how they are approached.

    Returns:
        The task; its output `arm_reference` is what the arm is to follow.
    """
    X_FBase = fixed_pose("ArmSetup.X_FBase", setup.X_FBase)
    q_home = np.array(setup.q_start)
    hand = CarriedHand(parts.arm_plant, parts.arm_alone, parts.hand.config, X_FBase, q_home)
    planner = PlacePlanner(hand, parts.model, grip, params)
    task: PlaceTask = builder.AddNamedSystem("place_task", PlaceTask(planner, q_home))
    grasp = builder.GetSubsystemByName("grasp_controller")
    builder.Connect(grasp.GetOutputPort("holding"), task.GetInputPort("holding"))
    builder.Connect(grasp.GetOutputPort("status"), task.GetInputPort("grasp_status"))
    builder.Connect(task.GetOutputPort("open"), grasp.GetInputPort("open"))
    for name in ("contacts", "fingers_in_contact", "hypotheses"):
        builder.Connect(parts.estimation.GetOutputPort(name), task.GetInputPort(name))
    builder.Connect(parts.senses["joint_positions"], task.GetInputPort("joint_positions"))
    builder.Connect(parts.palm_pose, task.GetInputPort("palm_pose"))
    builder.Connect(task.GetOutputPort("planes"), parts.estimation.GetInputPort("planes"))
    return task
