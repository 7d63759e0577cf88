"""The list of shipped objects: shape, mass, friction and color of each."""

from collections.abc import Callable
from dataclasses import dataclass

import trimesh

from . import bust, household, pottery, spray_bottle


@dataclass(frozen=True, kw_only=True)
class ObjectSpec:
    """One shipped object."""

    build: Callable[[], trimesh.Trimesh]  # its surface, in m
    mass: float  # kg, spread evenly over the enclosed solid
    friction: float  # Coulomb coefficient, static and dynamic
    color: tuple[float, float, float]  # red, green, blue in 0 to 1


CATALOGUE = {
    "cube": ObjectSpec(build=household.cube, mass=0.13, friction=0.9, color=(0.85, 0.65, 0.4)),
    "cylinder": ObjectSpec(build=household.cylinder, mass=0.2, friction=0.9, color=(0.75, 0.55, 0.35)),
    "soda_can": ObjectSpec(build=household.soda_can, mass=0.36, friction=0.8, color=(0.8, 0.15, 0.15)),
    "tea_box": ObjectSpec(build=household.tea_box, mass=0.12, friction=0.9, color=(0.3, 0.55, 0.3)),
    "thermal_bottle": ObjectSpec(build=household.thermal_bottle, mass=0.78, friction=0.9, color=(0.45, 0.5, 0.55)),
    "wine_glass": ObjectSpec(build=household.wine_glass, mass=0.24, friction=0.8, color=(0.75, 0.85, 0.9)),
    "pencil": ObjectSpec(build=household.pencil, mass=0.0055, friction=0.8, color=(0.95, 0.75, 0.2)),
    "light_bulb": ObjectSpec(build=household.light_bulb, mass=0.06, friction=0.8, color=(0.95, 0.95, 0.9)),
    "mug": ObjectSpec(build=pottery.mug, mass=0.32, friction=0.9, color=(0.9, 0.9, 0.9)),
    "bust": ObjectSpec(build=bust.bust, mass=0.4, friction=0.9, color=(0.9, 0.88, 0.82)),
    "spray_bottle": ObjectSpec(build=spray_bottle.spray_bottle, mass=0.58, friction=0.9, color=(0.55, 0.75, 0.9)),
    "screwdriver": ObjectSpec(build=household.screwdriver, mass=0.11, friction=1.0, color=(0.85, 0.35, 0.1)),
}
