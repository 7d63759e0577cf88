"""Adds the task of taking and placing a rod to an arm's station."""

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
    """Adds a `PlaceTask` named "place_task", connected to the station's estimation; for `make_arm_station`.

    Args:
        builder: the station's builder, which has a "grasp_controller".
        parts: the station's parts.
        setup: the arm's setup.
        grip: the axis along which the hand holds a rod best, in P.
        params: places of table and hole, and limits of the motions.

    Returns:
        The task; its output `arm_reference` is the arm's reference.
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
