"""Joints as a hand measures them, in the order of its plant; and what that tells of where things are."""

import numpy as np
import pytest
from pydrake.systems.framework import Context

from tactopose_drake.hand.hand_config import load_hand_config
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.joint_matrices import joint_matrix
from tactopose_drake.hand.kinematics import JointPaths
from tactopose_drake.station.can_senses import BarrettPucks
from tactopose_drake.systems.measured_joints import MeasuredJoints


@pytest.fixture(scope="module")
def hand():
    return make_hand_plant(load_hand_config("barrett_like"))


def evaluate(system: MeasuredJoints, measured: np.ndarray) -> np.ndarray:
    context: Context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, measured)
    return system.get_output_port().Eval(context)


def test_a_joint_that_is_not_known_leaves_the_others(hand) -> None:
    plant, parts = hand
    matrix = joint_matrix(plant, parts, BarrettPucks().joints)
    system = MeasuredJoints(matrix)
    measured = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    np.testing.assert_allclose(evaluate(system, measured), matrix @ measured)
    measured[[1, 4]] = np.nan  # finger 2
    unknown = np.isnan(evaluate(system, measured))
    lost = {"finger_2_proximal_joint", "finger_2_distal_joint"}
    assert {name for name in names(plant) if unknown[plant.GetJointByName(name).position_start()]} == lost


def test_offsets_are_added_and_each_reading_counts() -> None:
    system = MeasuredJoints(np.array([[0.0, 2.0], [-1.0, 0.0], [0.0, 1.0]]), np.array([0.5, 0.0, -0.25]))
    context = system.CreateDefaultContext()
    for measured, expected in (([1.0, 3.0], [6.5, -1.0, 2.75]), ([2.0, 4.0], [8.5, -2.0, 3.75])):
        system.get_input_port().FixValue(context, measured)
        np.testing.assert_array_equal(system.get_output_port().Eval(context), expected)


def names(plant) -> list[str]:
    joints = (plant.get_joint(index) for index in plant.GetJointIndices())
    return [joint.name() for joint in joints if joint.num_positions() == 1]


def test_a_pose_is_known_exactly_where_the_joint_does_not_move_it(hand) -> None:
    plant, parts = hand
    context = plant.CreateDefaultContext()
    paths = JointPaths(plant, parts.palm_frame)
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(parts.model_instance)]

    def poses(q: np.ndarray) -> list[np.ndarray]:
        plant.SetPositions(context, q)
        frames = (body.body_frame() for body in bodies)
        return [plant.CalcRelativeTransform(context, parts.palm_frame, frame).GetAsMatrix34() for frame in frames]

    q = np.full(plant.num_positions(), 0.1)
    for k in range(len(q)):
        moved, unknown = q.copy(), q.copy()
        moved[k], unknown[k] = 0.3, np.nan
        stays = [np.allclose(before, after) for before, after in zip(poses(q), poses(moved), strict=True)]
        known = paths.known(unknown)
        assert [bool(known[int(body.index())]) for body in bodies] == stays
        assert not all(stays)
    assert paths.known(q).all()
