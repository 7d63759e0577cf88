"""A pencil that is handed over with random errors, the closing of the hand, and the diagram of the task.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.2.3.
"""

import dataclasses
import functools
import math
import shutil
from pathlib import Path

import numpy as np
import trimesh
from pydrake.common.schema import Transform
from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, OutputPort

import tactopose_drake as tp
from tactopose_drake.core.grasping import GraspPlan, HeldAxis, PlannerParams, ReachParams, plan_grasps
from tactopose_drake.core.poses import exp_so3
from tactopose_drake.hand import load_hand_config, make_hand_reach
from tactopose_drake.resources import model_path
from tactopose_drake.station import (
    AddPlaceTask,
    ArmParts,
    ArmSetup,
    ArmStation,
    PlaceParams,
    Scenario,
    SceneModel,
    make_arm_station,
)

LENGTH, MASS = 0.175, 0.0055  # of the pencil, m, kg
TURN, SHIFT, SLIDE = math.radians(10.0), 0.005, 0.020  # limits of the hand-over's errors, in both directions, rad and m
# The simulator's table is an elastic foundation with a pressure of 5e8 Pa per metre of depth. The 0.1 to 0.3 N that are
# needed for detection press the rigid pencil's blunt edge 0.2 to 0.4 mm into it, and its point 0.4 to 0.8 mm.
GIVE = 0.0005  # assumed penetration, in between, m
# A held object creeps in the simulator's contact, the more the longer its steps. In a hand at rest, a pencil turned by
# 0.13 degrees per second with steps of 4 ms, by 0.06 with 2 ms and by 0.03 with 1 ms; during the arm's motion to the
# table, it moved by 1.6, 0.8 and 0.4 mm.
STEP = 0.002  # s
# The hand closes as if on this bar, but farther, and with more force, until the pencil stops it.
BAR_RADIUS, BEYOND, FIRMNESS = 0.006, 8.0, 1.5  # m, N of push, share of the planned force


@functools.cache
def plan_closing() -> GraspPlan:
    """Plans the closing of the hand, which is the same for every pencil: across the palm, with all five fingers.

    The outer fingers press from the palm's side, the two between them from the front, and the thumb presses the bar
    into the groove that they form, so that the five forces balance almost without friction. A grip whose balance needs
    friction holds at first; then the pencil creeps, turns, and slips out.
    """
    bar = trimesh.creation.cylinder(radius=BAR_RADIUS, height=LENGTH, sections=64)
    bar.apply_translation([0.0, 0.0, 0.5 * LENGTH])
    # Away from the joints' limits, so that a finger that meets the pencil later than planned can close farther.
    reach = make_hand_reach(load_hand_config("shadow_like"), ReachParams(lift=0.02, limit_margin=0.12))
    params = PlannerParams(
        grasps=3, least_fingers=5, tilt_deg=10.0, normal_force=2.0, least_force=1.0, friction=0.15
    )  # fmt: skip
    thumb_up = np.array([-0.05, 0.0, 0.0])  # the weight, N, in P
    model = tp.ObjectModel.from_mesh(bar, mass=MASS)
    plan = plan_grasps(model, reach, thumb_up, params, np.random.default_rng(6))[0]
    fingers = {}
    for name, part in plan.fingers.items():
        motion = part.motion
        q_touch = motion.q_touch + BEYOND * motion.closing
        motion = dataclasses.replace(motion, q_touch=q_touch, set_force=FIRMNESS * motion.set_force)
        fingers[name] = dataclasses.replace(part, motion=motion)
    return dataclasses.replace(plan, fingers=fingers)


def best_grip(closing: GraspPlan) -> HeldAxis:
    """The axis of the bar of the plan, held by its middle, directed to its lower end."""
    p_PG = np.mean([part.p_PC for part in closing.fingers.values()], axis=0)
    direction, p_PB = -closing.X_PO[:, 2], closing.X_PO[:, 3]
    return HeldAxis(p_PB + ((p_PG - p_PB) @ direction) * direction, direction, 0.5 * LENGTH)


def hand_over(plan: GraspPlan, generator: np.random.Generator) -> GraspPlan:
    """The same closing, with a random pose of the pencil."""
    axis, p_PB = plan.X_PO[:, 2], plan.X_PO[:, 3]
    grip = np.mean([part.p_PC for part in plan.fingers.values()], axis=0)
    middle = p_PB + ((grip - p_PB) @ axis) * axis + generator.uniform(-SHIFT, SHIFT, 3)
    spin = exp_so3(np.array([0.0, 0.0, generator.uniform(-math.pi, math.pi)]))
    R_PO = exp_so3(generator.uniform(-TURN, TURN, 3)) @ plan.X_PO[:, :3] @ spin
    if generator.random() < 0.5:
        R_PO = R_PO @ np.diag([1.0, -1.0, -1.0])
    height = 0.5 * LENGTH + generator.uniform(-SLIDE, SLIDE)
    return dataclasses.replace(plan, X_PO=np.column_stack([R_PO, middle - height * R_PO[:, 2]]))


def write_collision_pencil(folder: Path) -> Path:
    """Writes the package's pencil for the simulator, with long triangles between its edges instead of short ones.

    The surface differs by 0.02 mm where the hand holds it, and by 0.3 mm where the sharpening begins; the contact
    problems become half as large.
    """
    folder.mkdir(parents=True, exist_ok=True)
    vertices = trimesh.load_mesh(model_path("objects", "pencil.obj")).vertices
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])
    # Three points at each of the six edges, 5 degrees apart; the other points of a ring are on the flats between them.
    on_edge = np.abs(np.mod(angle + math.pi / 6, math.pi / 3) - math.pi / 6) < math.radians(6.0)
    rings = np.array([0.0, 0.0006, 0.149, 0.15139, 0.15378, 0.15617, 0.15936, 0.16255, 0.1745, 0.175])
    on_ring = np.abs(vertices[:, 2:] - rings).min(axis=1) < 3e-5
    trimesh.PointCloud(vertices[on_edge & on_ring]).convex_hull.export(folder / "pencil.obj")
    return Path(shutil.copy(model_path("objects", "pencil.sdf"), folder / "pencil.sdf"))


def make_trial_station(closing: GraspPlan, pencil: Path, meshcat: Meshcat | None = None) -> ArmStation:
    """The whole diagram: sensing, estimation, decision and control; shown in Meshcat, if given."""
    scenario = Scenario(object=str(pencil)).without_errors()
    scenario.plant.time_step = STEP
    scenario.controller.closing_time = 1.6
    # All points of a pencil are within two millimetres of an edge, where normals are uncertain.
    scenario.estimation.contacts.sigma_position = 0.0006
    scenario.estimation.contacts.sigma_normal_deg = 8.0
    scenario.estimation.estimator.period = 0.4  # the unknown position along a rod makes wide modes, which are slow
    place = PlaceParams(table_give=GIVE)
    scenes = "package://tactopose_drake/models/scenes"
    box = Transform(translation=[*place.p_WHole[:2], 0.0])
    setup = ArmSetup(scene=[SceneModel(model=f"{scenes}/table.sdf"), SceneModel(model=f"{scenes}/hole_box.sdf")])
    setup.scene[1].X_WModel = box

    def add_decision(builder: DiagramBuilder, parts: ArmParts) -> OutputPort:
        task = AddPlaceTask(builder, parts, setup, best_grip(closing), place)
        builder.ExportOutput(task.GetOutputPort("phase"), "phase")
        return task.GetOutputPort("arm_reference")

    model = tp.ObjectModel.from_mesh(model_path("objects", "pencil.obj"), mass=MASS)
    return make_arm_station(scenario, closing, setup, add_decision, model=model, meshcat=meshcat)
