"""The appearance and the meaning of each part of a drawn estimate, in pictures, pages, Meshcat and notebooks.

The colours can be distinguished by people with any one colour vision deficiency. Parts with similar colours differ in
shape: only the estimate is a solid; poses to compare it with are lines; contacts are balls and arrows.
"""

from typing import Literal, NamedTuple

Colour = tuple[float, float, float]
Mark = Literal["solid", "ghost", "line", "ball", "cross", "pin", "arrow", "turn", "ellipsoid", "cell", "frame", "cone"]


class Look(NamedTuple):
    """How one kind of part is drawn.

    Attributes:
        name: its name in a legend.
        colour: red, green, blue, 0 to 1.
        mark: its symbol in a legend.
        meaning: its explanation in a legend, a few words.
    """

    name: str
    colour: Colour
    mark: Mark
    meaning: str


ESTIMATE = Look("estimate", (0.20, 0.55, 0.85), "solid", "the most probable pose")
ALTERNATIVE = Look("another hypothesis", (0.10, 0.62, 0.58), "ghost", "the more opaque, the more probable")
PRIOR = Look("prior", (0.93, 0.55, 0.20), "line", "where it was thought to be before")
TRUTH = Look("true pose", (0.06, 0.45, 0.16), "line", "where it is in the simulation")
UNCERTAINTY = Look(
    "95 % region",
    (0.04, 0.13, 0.40),
    "ellipsoid",
    "where its points are, as far as determined",
)
FREE = Look("not determined", (0.55, 0.20, 0.70), "turn", "it may move so without being felt")
CONTACT = Look("contact", (0.85, 0.10, 0.20), "ball", "of the object, numbered as in the input")
FALSE_CONTACT = Look("false contact", (0.50, 0.51, 0.53), "cross", "probably not of this object")
NORMAL = Look("contact normal", (0.36, 0.38, 0.43), "pin", "out of the object, as it was felt")
FORCE = Look("contact force", (0.85, 0.10, 0.20), "arrow", "of the object on the finger")
PRESSURE = Look("pressed cells", (0.98, 0.80, 0.08), "cell", "of a tactile pad; the larger, the more pressure")
PATCH_AXES = Look("patch axes", (0.45, 0.24, 0.06), "pin", "principal axes of where the pressed cells are")
CONE = Look("friction cones", (0.36, 0.38, 0.43), "cone", "in which the forces lie where nothing slips")
FRAMES = Look("frames", (0.36, 0.38, 0.43), "frame", "of palm P and object O: x red, y green, z blue")
HAND = Look("hand", (0.62, 0.64, 0.67), "solid", "at this instant")

ROLES = {"estimate": ESTIMATE, "prior": PRIOR, "truth": TRUTH}
"""The looks of an object's poses, by their role."""

AXIS_COLOURS: tuple[Colour, Colour, Colour] = ((0.85, 0.15, 0.15), (0.10, 0.60, 0.20), (0.15, 0.30, 0.85))
"""Colours of the x, y and z axes."""

LEAST_INLIER_PROBABILITY = 0.5
"""Contacts with a lower probability of being on the object are drawn as false contacts."""
MOST_FREE = 3
"""Maximum number of free directions that are drawn; more than these are only named in the text."""
LONGEST_ARROW = 0.05
"""Length of the arrow of the largest force, m; the other arrows are in proportion."""
MOST_ALTERNATIVES = 5
"""Maximum number of hypotheses that are drawn beside the best."""
LEAST_ALTERNATIVE = 0.01
"""Minimum probability of a hypothesis that is drawn beside the best."""
MOVING_ALTERNATIVES = 2
"""Maximum number of hypotheses that are drawn beside the best in a recording, which keeps the recording small."""
