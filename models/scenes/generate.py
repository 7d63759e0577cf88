"""Writes the scene of an arm: table.sdf, and hole_box.sdf, a hollow box with a round hole in its lid.

Run `python models/scenes/generate.py` after changing a number. The table's top is z = 0 of its frame. The box stands on
z = 0 of its frame, the hole's axis is z; both are made of boxes.
"""

import math
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "hands"))  # the generators' shared module is next to the hands

import sdf_parts as sdf
from sdf_parts import Link, Solid

RADIUS = 0.015  # radius of the hole, m: that of the inscribed circle of its sides
SIDES = 16
WIDTH = 0.12  # width of the box, m
HEIGHT = 0.10  # m
WALL = 0.006  # m
TABLE = (1.8, 1.8, 0.04)  # m
WOOD, LID = "0.72 0.56 0.38 1", "0.80 0.66 0.48 1"
# Half the side of the square around the hole that the ring fills; slightly less than the ring covers everywhere.
WINDOW = 0.030


def box_solids() -> list[Solid]:
    z_lid, z_wall, height = HEIGHT - WALL / 2, HEIGHT / 2, HEIGHT - 2 * WALL
    rim = (WIDTH / 2 - WINDOW, (WIDTH / 2 + WINDOW) / 2)  # width of a plate next to the window, and its centre
    solids = [Solid(kind="box", size=(WIDTH, WIDTH, WALL), center=(0, 0, WALL / 2), color=WOOD)]
    for sign in (-1, 1):
        wall = sign * (WIDTH - WALL) / 2
        solids += [
            Solid(kind="box", size=(WALL, WIDTH, height), center=(wall, 0, z_wall), color=WOOD),
            Solid(kind="box", size=(WIDTH - 2 * WALL, WALL, height), center=(0, wall, z_wall), color=WOOD),
            Solid(kind="box", size=(rim[0], WIDTH, WALL), center=(sign * rim[1], 0, z_lid), color=LID),
            Solid(kind="box", size=(2 * WINDOW, rim[0], WALL), center=(0, sign * rim[1], z_lid), color=LID),
        ]
    outer = math.sqrt(2.0) * WINDOW
    for i in range(SIDES):
        angle = 2 * math.pi * i / SIDES
        middle = (RADIUS + outer) / 2
        center = (middle * math.cos(angle), middle * math.sin(angle), z_lid)
        width = 2 * outer * math.tan(math.pi / SIDES)
        solids.append(
            Solid(kind="box", size=(outer - RADIUS, width, WALL), center=center, rpy=(0, 0, angle), color=LID)
        )
    return solids


def model_files() -> dict[str, str]:
    table = Solid(kind="box", size=TABLE, center=(0, 0, -TABLE[2] / 2), color="0.55 0.45 0.36 1")
    links = [Link(name="hole_box", mass=0.4, solids=box_solids()), Link(name="table", mass=30.0, solids=[table])]
    return {f"{link.name}.sdf": sdf.model_text(link.name, [link], [], group="parts") for link in links}


if __name__ == "__main__":
    for name, text in model_files().items():
        Path(__file__).with_name(name).write_text(text, encoding="utf-8")
