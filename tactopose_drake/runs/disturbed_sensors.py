"""Finds simulated force-torque sensors whose readings are not due to the object's contact alone."""

import numpy as np
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context

from tactopose_drake.estimation.drake_contacts import reported_contacts
from tactopose_drake.station.simulated import Station

_LEAST = 0.05  # least force of another part of the hand that is reported, N


def disturbed_sensors(station: Station, context: Context) -> tuple[str, ...]:
    """A sentence for each sensor that is saturated, and for each fingertip that another part of the hand touches.

    Args:
        station: the simulated station.
        context: its root context.
    """
    plant, hand, said = station.plant, station.hand, []
    plant_context = plant.GetMyContextFromRoot(context)
    results = plant.get_contact_results_output_port().Eval(plant_context)
    of_hand = {int(index) for index in plant.GetBodyIndices(hand.model_instance)}
    limits = np.array(station.scenario.sensor.model().range)
    for finger, weld in hand.welds.items():
        sensor = station.diagram.GetSubsystemByName(f"sensor_{finger}")
        status: str = sensor.GetOutputPort("status").Eval(sensor.GetMyContextFromRoot(context))
        if status.startswith("saturated"):
            most = f"{limits[3:].min():g} N and {limits[:3].min():g} N m"
            said.append(
                f"The sensor of {finger} is {status.replace(':', ' in')}, so that its contact is off: it measures up "
                f"to {most}; set another calibration by the scenario's `sensor.calibration`."
            )
        touched = [
            plant.get_body(BodyIndex(contact.partner)).name()
            for contact in reported_contacts(results, plant, plant_context, weld.child_body())
            if contact.partner in of_hand and np.linalg.norm(contact.f_W) > _LEAST
        ]
        if touched:
            parts = ", ".join(dict.fromkeys(touched))
            said.append(f"The fingertip of {finger} also touches {parts}, which its sensor feels: its contact is off.")
    return tuple(said)
