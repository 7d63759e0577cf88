"""Draws the diagrams of the documentation: the pose estimation alone, and in the simulated station.

Both are drawn for a hand with fingertip sensors, and for one with tactile pads. A third shows the belief in a control
stack, as proposed in figure 6.5 of the thesis: sensing, prediction, update, and decision. Unlike
`diagram.GetGraphvizString()`, which shows everything, these diagrams are simplified: systems and ports that exist once
per finger or pad are drawn once, as `<finger>` or `<pad>`; unconnected ones, sources of noise and the scene graph are
omitted.
"""

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from html import escape
from itertools import zip_longest
from pathlib import Path
from types import MappingProxyType

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPortIndex, OutputPort, OutputPortIndex, System

from tactopose_drake.core.grasping import GraspPlan, HeldAxis
from tactopose_drake.resources import resource_root
from tactopose_drake.station import (
    AddPlaceTask,
    ArmParts,
    ArmSetup,
    ArmStation,
    PlaceParams,
    Scenario,
    load_scenario,
    make_arm_station,
    make_station,
)
from tactopose_drake.systems import CameraView, PoseTrackingParams, SimulatedVision, SimulatedVisionParams

LEFT_OUT = ("RandomSource", "SceneGraph")
STYLE = """rankdir=LR; ranksep=0.6; nodesep=0.12; bgcolor=white;
node [shape=plain, fontname="Arial,Helvetica,sans-serif", fontsize=13]; edge [arrowsize=0.7, color="#5b6470"];"""
FRAME = 'style="rounded,filled"; color="#c9d3e0"; fillcolor="#eef2f8"; fontname="Arial,Helvetica,sans-serif";'
INPUT, OUTPUT = "#1f5fa8", "#2e7d32"  # colours of what goes into the diagram, and what comes out

# Tail and head of a connection: system and port each; for the diagram's own ports, the system is "".
Edge = tuple[str, str, str, str]


def connections(diagram: Diagram) -> list[Edge]:
    """All connections between systems that are not omitted, and those of the diagram's own ports."""
    edges: list[tuple[System | None, str, System | None, str]] = []
    for (head, i), (tail, o) in diagram.connection_map().items():
        edges.append((tail, tail.get_output_port(o).get_name(), head, head.get_input_port(i).get_name()))
    for index in range(diagram.num_input_ports()):
        name = diagram.get_input_port(index).get_name()
        for head, i in diagram.GetInputPortLocators(InputPortIndex(index)):
            edges.append((None, name, head, head.get_input_port(i).get_name()))
    for index in range(diagram.num_output_ports()):
        tail, o = diagram.get_output_port_locator(OutputPortIndex(index))
        edges.append((tail, tail.get_output_port(o).get_name(), None, diagram.get_output_port(index).get_name()))
    return [
        (tail.get_name() if tail else "", out, head.get_name() if head else "", into)
        for tail, out, head, into in edges
        if not {kind(system) for system in (tail, head) if system} & set(LEFT_OUT)
    ]


def kind(system: System) -> str:
    """The name of a system's class."""
    return re.sub(r"<.*", "", system.GetSystemType()).split("::")[-1].split(".")[-1]


def opened(diagram: Diagram, name: str) -> tuple[dict[str, System], list[Edge]]:
    """The systems of a diagram and their connections, with one of them replaced by its own subsystems."""
    part = diagram.GetSubsystemByName(name)
    systems = {system.get_name(): system for system in (*diagram.GetSystems(), *part.GetSystems()) if system != part}
    outer, inner = connections(diagram), connections(part)
    edges = [edge for edge in outer if name not in (edge[0], edge[2])] + [edge for edge in inner if edge[0] and edge[2]]
    for tail, out, head, into in outer:
        if head == name:
            edges += [(tail, out, *edge[2:]) for edge in inner if edge[:2] == ("", into)]
        if tail == name:
            edges += [(*edge[:2], head, into) for edge in inner if edge[2:] == ("", out)]
    return systems, edges


def to_dot(
    systems: Mapping[str, System],
    connected: Sequence[Edge],
    endings: Sequence[str],
    ending: str,
    groups: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> str:
    """A diagram in the language of Graphviz.

    Args:
        systems: its systems, by name.
        connected: its connections.
        endings: names that exist with each of these endings are drawn once.
        ending: the ending that replaces them.
        groups: names of the systems that are drawn in a common frame, by its title.
    """
    names = {*systems} | {name for _, out, _, into in connected for name in (out, into)}

    def once(name: str) -> str:
        stem = re.sub(rf"(?<![^_])({'|'.join(endings)})$", "", name)
        return stem + ending if stem != name and all(stem + each in names for each in endings) else name

    edges = {tuple(once(name) for name in edge) for edge in connected}
    lines = [STYLE]
    for name, system in {once(name): system for name, system in systems.items()}.items():
        inputs = [once(system.get_input_port(i).get_name()) for i in range(system.num_input_ports())]
        outputs = [once(system.get_output_port(i).get_name()) for i in range(system.num_output_ports())]
        used_in = [port for port in dict.fromkeys(inputs) if any(edge[2:] == (name, port) for edge in edges)]
        used_out = [port for port in dict.fromkeys(outputs) if any(edge[:2] == (name, port) for edge in edges)]
        if used_in or used_out:
            lines.append(f'"{name}" [label={box(name, kind(system), used_in, used_out)}];')
    for index, (title, members) in enumerate(groups.items()):
        inside = " ".join(f'"{name}";' for name in dict.fromkeys(map(once, members)))
        lines.append(f"subgraph cluster_{index} {{ label=<<B>{title}</B>>; {FRAME} {inside} }}")
    for tail, out, head, into in sorted(edges):
        if not tail:
            lines.append(f'"in {out}" [label=<{escape(out)}>, fontcolor="{INPUT}"];')
        if not head:
            lines.append(f'"out {into}" [label=<{escape(into)}>, fontcolor="{OUTPUT}"];')
        start = f'"{tail}":"out {out}":e' if tail else f'"in {out}":e'
        end = f'"{head}":"in {into}":w' if head else f'"out {into}":w'
        colour = "" if tail and head else f' [color="{OUTPUT if tail else INPUT}"]'
        lines.append(f"{start} -> {end}{colour};")
    return "digraph {\n" + "\n".join(lines) + "\n}\n"


def box(name: str, title: str, inputs: Sequence[str], outputs: Sequence[str]) -> str:
    """The label of a system: its class, its name, and its ports."""

    def cell(port: str, side: str, align: str) -> str:
        return f'<TD ALIGN="{align}" PORT="{side} {escape(port)}">{escape(port)}</TD>' if port else "<TD></TD>"

    rows = [
        f"<TR>{cell(into, 'in', 'LEFT')}<TD> </TD>{cell(out, 'out', 'RIGHT')}</TR>"
        for into, out in zip_longest(inputs, outputs, fillvalue="")
    ]
    heading = f'<B>{title}</B><BR/><FONT POINT-SIZE="11" COLOR="#5b6470">{escape(name)}</FONT>'
    return (
        '<<TABLE BORDER="1" CELLBORDER="0" CELLSPACING="0" CELLPADDING="4" STYLE="ROUNDED" COLOR="#8a929c"'
        f' BGCOLOR="#f6f7f9"><TR><TD COLSPAN="3">{heading}</TD></TR><HR/>{"".join(rows)}</TABLE>>'
    )


def any_grasp(scenario: Scenario) -> Scenario:
    """The scenario with a single planned grasp, since the diagram does not depend on the grasp."""
    scenario.planner.grasps = 1
    return scenario


def make_control_stack(plan: GraspPlan) -> ArmStation:
    """A hand on an arm that puts a handed-over pencil into a hole, based on its belief; any plan will do."""
    setup = ArmSetup()

    def add_decision(builder: DiagramBuilder, parts: ArmParts) -> OutputPort:
        vision = builder.AddNamedSystem(
            "vision",
            SimulatedVision(
                CameraView(
                    plant=parts.plant,
                    inspector=parts.scene_graph.model_inspector(),
                    object_body=parts.object_body,
                    object_model=parts.model,
                    palm_frame=parts.hand.palm_frame,
                    X_WC=RigidTransform(),
                ),
                params=SimulatedVisionParams(),
            ),
        )
        builder.Connect(parts.plant.get_body_poses_output_port(), vision.GetInputPort("body_poses"))
        builder.Connect(vision.GetOutputPort("prior"), parts.estimation.GetInputPort("vision"))
        grip = HeldAxis(np.array([0.0, -0.05, 0.11]), np.array([-1.0, 0.0, 0.0]), 0.0875)
        task = AddPlaceTask(builder, parts, setup, grip, PlaceParams())
        return task.GetOutputPort("arm_reference")

    return make_arm_station(Scenario(object="pencil", tracking=PoseTrackingParams()), plan, setup, add_decision)


def draw_control_stack(plan: GraspPlan) -> str:
    """Figure 6.5 of the thesis as a diagram, in the language of Graphviz."""
    station = make_control_stack(plan)
    fingers = tuple(station.hand.sensor_frames)
    systems, edges = opened(station.diagram, "pose_tracking")
    sensors = [f"sensor_{finger}" for finger in fingers]
    touch = ["contact_solver", "fingertip_inertia", "contacts_in_palm"]
    groups = {
        "Sensing": [*sensors, "joint_positions", "vision", "palm_pose", *touch],
        "Prediction": ["fingertip_velocities"],
        "Update": ["hand_volume", "pose_belief"],
        "Decision": ["place_task", "grasp_controller", "arm_controller"],
    }
    inside = [edge for edge in edges if edge[0] and edge[2]]
    return to_dot(systems, inside, fingers, "<finger>", groups)


def main() -> None:
    """Writes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    here = resource_root() / "docs" / "pictures"
    parser.add_argument("folder", nargs="?", type=Path, default=here, help="docs/pictures by default")
    folder = parser.parse_args().folder
    try:
        from pygraphviz import AGraph
    except ImportError:
        sys.exit("draw_diagrams.py: pygraphviz is missing; `pip install pygraphviz` brings Graphviz with it.")
    folder.mkdir(parents=True, exist_ok=True)

    def draw(dot: str, path: Path) -> None:
        path.write_bytes(AGraph(dot).draw(format="svg", prog="dot"))

    for scenario, suffix in (("shadow_like", ""), ("barrett_like", "_barrett")):
        station = make_station(any_grasp(load_scenario(scenario).without_errors()))
        fingers, pads = tuple(station.hand.sensor_frames), tuple(station.hand.pad_frames)
        endings, ending = (fingers, "<finger>") if fingers else (pads, "<pad>")
        pictures = {
            "pose_estimation": station.diagram.GetSubsystemByName("pose_estimation"),
            "station": station.diagram,
        }
        for name, diagram in pictures.items():
            systems = {system.get_name(): system for system in diagram.GetSystems()}
            draw(to_dot(systems, connections(diagram), endings, ending), folder / f"{name}{suffix}.svg")
        if station.plan is not None:
            draw(draw_control_stack(station.plan), folder / "control_stack.svg")


if __name__ == "__main__":
    main()
