"""Titles of pages of grasps."""

from pathlib import Path

from tactopose_drake.station.scenario import Scenario


def grasp_title(scenario: Scenario, hand: str = "") -> str:
    """A title with the names of the scenario's object and hand, which may be given as paths.

    Args:
        scenario: the scenario of the grasp.
        hand: a word on the hand, such as "simulated".
    """
    thing = Path(scenario.object).stem.replace("_", " ")
    name = Path(scenario.hand).name.split(".")[0].replace("_", "-")
    return f"{thing[0].upper()}{thing[1:]} in the {hand + ' ' if hand else ''}{name} hand"
