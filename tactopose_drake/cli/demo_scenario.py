"""The scenario of a demonstration: one of the package, or one made for the user's own hand or object."""

from pathlib import Path

from tactopose_drake.core.validation import either
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.resources import shipped_objects
from tactopose_drake.station.own_hand import scenario_for
from tactopose_drake.station.own_object import write_simulated_object
from tactopose_drake.station.scenario import Scenario, load_scenario

_WITH_SCENARIO = ("shadow_like", "barrett_like")  # hands that have a scenario with their name
_OBJECT = "cube"  # default object for other hands


def demo_scenario(hand: str, name: str | None, seed: int, folder: Path, scale: float, mass: float | None) -> Scenario:
    """Makes the scenario of a demonstration.

    Args:
        hand: one of the package by name, or a *.hand.yaml by path.
        name: an object of the package by name, or a mesh or model by path; None: one that suits the hand.
        seed: seed of the grasp and all noise.
        folder: an empty folder that receives the SDF and OBJ of an object that is given by path.
        scale: metres per unit of the object's mesh.
        mass: mass of the object, kg; None: its file's, or that of water.

    Raises:
        InvalidInputError: if the files cannot be used, a scale or mass is given for an object of the package, or the
            hand closes without a plan and its scenario has no pose for the object.
    """
    scenario = load_scenario(hand) if hand in _WITH_SCENARIO else None
    if scenario is not None and scenario.grip is not None and name is not None and name not in scenario.grip.X_PO:
        raise InvalidInputError(
            f"--object must be one that the hand {hand!r} can hold, which closes without a plan: "
            f"{either(sorted(scenario.grip.X_PO))}, not {name!r}. Other hands plan grasps of any object."
        )
    if name is not None and name not in shipped_objects():
        name = str(write_simulated_object(load_object(name, scale=scale, mass=mass), folder))
    elif scale != 1.0 or mass is not None:
        raise InvalidInputError("--scale and --mass must be left out unless --object is a file's path.")
    if scenario is None:
        return scenario_for(hand, name or _OBJECT, seed)
    scenario.object, scenario.seed = name or scenario.object, seed
    return scenario
