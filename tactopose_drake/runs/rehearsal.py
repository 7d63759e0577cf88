"""Simulates a scenario's grasp ahead of a real-time run with simulated devices, and records the hand's senses."""

import dataclasses

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.runs.simulation import start_simulation
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.station.senses import SimulatedSenses
from tactopose_drake.station.simulated import make_station
from tactopose_drake.systems.signals import Signal, SignalRecorder


def rehearse(scenario: Scenario, model: ObjectModel) -> dict[str, Signal]:
    """Simulates the scenario's best planned grasp for the scenario's duration.

    Returns:
        The signals of the simulated sensors by name: `joint_positions`, `prior`, `wrench_<finger>`, `pressures_<pad>`,
        and `true_pose`, the true X_PO.

    Raises:
        InvalidInputError: if the scenario cannot be built.
    """
    # No estimates are needed.
    estimator = dataclasses.replace(scenario.estimation.estimator, period=2 * scenario.duration)
    estimation = dataclasses.replace(scenario.estimation, estimator=estimator)
    scenario = dataclasses.replace(scenario, senses=SimulatedSenses(), estimation=estimation)
    with SignalRecorder() as recorder:
        start_simulation(make_station(scenario, model=model), recorder.write).AdvanceTo(scenario.duration)
        return recorder.signals
