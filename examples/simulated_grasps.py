"""Readings of a hand with errors in simulated grasps, for calibrations and their evaluation."""

import dataclasses

import numpy as np

import tactopose_drake as tp
from tactopose_drake.hand import ClosedGrasp, HandErrors, make_hand_plant
from tactopose_drake.runs import GraspResult, run_grasp
from tactopose_drake.station import (
    FingerErrors,
    Scenario,
    SimulatedErrors,
    load_scenario,
    make_station,
    plan_scenario,
)

TOUCHES = 0.3  # minimum force of a contact, N; smaller ones may be a bias
PLANS = 4  # planned grasps that are tried per search
SEARCHES = 10  # maximum number of searches for one object


def as_simulated(errors: HandErrors, vector: np.ndarray) -> SimulatedErrors:
    """A hand's errors in the form of a scenario.

    Args:
        errors: the errors that it may have.
        vector: their values, shape (d,), SI units.
    """
    fingers = {}
    for name in errors.fingers:
        own = errors.of_finger(vector, name)
        fingers[name] = FingerErrors(
            radius=own.radius,
            mounting=own.mounting[3:].tolist(),
            mounting_deg=np.degrees(own.mounting[:3]).tolist(),
            sensor_moment=own.bias[:3].tolist(),
            sensor_force=own.bias[3:].tolist(),
        )
    offsets = dict(zip(errors.joints, np.degrees(errors.offsets(vector)).tolist(), strict=True))
    return SimulatedErrors(joint_offsets_deg=offsets, fingers=fingers)


def simulated_grasps(
    scenario: Scenario, model: tp.ObjectModel, count: int, generator: np.random.Generator
) -> list[ClosedGrasp]:
    """At most `count` grasps that hold the scenario's object, with the hand's readings at the end."""
    found: list[ClosedGrasp] = []
    for _ in range(SEARCHES):
        if len(found) == count:
            break
        scenario = dataclasses.replace(scenario, seed=int(generator.integers(1 << 30)))
        for plan in plan_scenario(scenario, model)[:PLANS]:
            if len(found) == count:
                break
            result = run_grasp(make_station(scenario, plan, model=model))
            if result.stable:
                found.append(read_grasp(result))
    return found


def simulated_scenario(hand: str, name: str, errors: SimulatedErrors) -> Scenario:
    """The shipped scenario with these errors, without estimates during the grasp."""
    scenario = load_scenario(hand)
    scenario.object, scenario.errors = name, errors
    scenario.estimation.estimator.period = 100.0  # s
    return scenario


def read_grasp(result: GraspResult) -> ClosedGrasp:
    """The hand's readings at the end, and the true pose."""
    station = result.station
    plant, parts = make_hand_plant(station.hand.config)
    read = {
        name: np.array(station.diagram.GetOutputPort(name).Eval(result.context))
        for name in ("joint_positions", *(f"wrench_{finger}" for finger in parts.sensor_frames))
    }
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(parts.model_instance)]
    named = {j.name(): float(read["joint_positions"][j.position_start()]) for j in joints if j.num_positions() == 1}
    felt = {finger: read[f"wrench_{finger}"] for finger in parts.sensor_frames}
    touching = {finger: wrench for finger, wrench in felt.items() if np.linalg.norm(wrench[3:]) > TOUCHES}
    return ClosedGrasp(tp.RecordedGrasp(station.model, named, touching), result.X_PO.GetAsMatrix34())
