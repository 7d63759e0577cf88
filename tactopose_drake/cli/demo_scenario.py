"""Which scenario a demonstration runs: one of the package, or one made for the user's own hand or object."""

from pathlib import Path

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.resources import shipped_objects
from tactopose_drake.station.own_hand import scenario_for
from tactopose_drake.station.own_object import write_simulated_object
from tactopose_drake.station.scenario import Scenario, load_scenario

_WITH_SCENARIO = ("shadow_like", "barrett_like")  # hands, whose scenarios have their names
_OBJECT = "cube"  # of a hand of one's own, unless another is asked for


def demo_scenario(hand: str, name: str | None, seed: int, folder: Path, scale: float, mass: float | None) -> Scenario:
    """The scenario of a demonstration.

    Args:
        hand: of the package by name, or a *.hand.yaml by path.
        name: an object of the package by name, or a mesh or model by path; None: one that suits the hand.
        seed: of the grasp and all noise.
        folder: receives the SDF and OBJ of an object that is given by path, and holds nothing else.
        scale: how many metres the unit of the object's mesh has.
        mass: of the object, kg; by default what its file says, or that of water.

    Raises:
        InvalidInputError: if the files cannot be used, a scale or mass is given for an object of the package, or the
            hand grips an object of which it is not known where in the hand it is held.
    """
    scenario = load_scenario(hand) if hand in _WITH_SCENARIO else None
    if scenario is not None and scenario.grip is not None and name is not None and name not in scenario.grip.X_PO:
        raise InvalidInputError(
            f"--object: is {name!r}, which the hand {hand!r} cannot hold, for it closes without a plan on what is put "
            f"into it; allowed with it are {', '.join(sorted(scenario.grip.X_PO))}. Other hands plan grasps of any."
        )
    if name is not None and name not in shipped_objects():
        name = str(write_simulated_object(load_object(name, scale=scale, mass=mass), folder))
    elif scale != 1.0 or mass is not None:
        raise InvalidInputError("--scale, --mass: are for an object that --object names by its path.")
    if scenario is None:
        return scenario_for(hand, name or _OBJECT, seed)
    scenario.object, scenario.seed = name or scenario.object, seed
    return scenario
