"""What is right and wrong with a hand's files, part by part."""

import copy
import dataclasses
import logging
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.geometry import Role, SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, RigidBody, SpatialInertia
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_properties import (
    leave_friction_out,
    rigid_shapes,
    self_collisions,
    unsaid_shapes,
)
from tactopose_drake.hand.coupling_check import check_couplings
from tactopose_drake.hand.findings import Entry, Finding, fault
from tactopose_drake.hand.finger_chain import joints_towards
from tactopose_drake.hand.fingertip_check import check_fingertips
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_fixed_hand, make_hand_plant, pose_by_model
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.hand.joint_check import check_joints, has_unlimited_joints
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.pad_check import check_pads
from tactopose_drake.resources import complaint_kind

_FARTHEST = 1.0  # from the palm, of a hand's collision shapes, m
_SLOWEST = 0.5  # s that a joint's damping may take to let the default grasp controller's spring close it
_STRUCTURE = ("joints", "couplings", "sensor_frame", "weld")  # of a finger, on which its surface depends
_STIFFNESS = ReachParams().stiffness  # N m/rad


@dataclasses.dataclass(frozen=True, eq=False)
class CheckedHand:
    """A hand alone, its base fixed, in a plant with its geometry."""

    diagram: Diagram
    plant: MultibodyPlant
    hand: Hand


@dataclasses.dataclass(frozen=True, eq=False)
class HandCheck:
    """What was found, part by part, and the hand that it was found of; None where its files do not give one.

    `entries` are what the hand's file should say instead, those of the findings and those that follow once they are
    taken.
    """

    findings: tuple[Finding, ...]
    parts: CheckedHand | None = None
    entries: tuple[Entry, ...] = ()

    @property
    def faults(self) -> tuple[Finding, ...]:
        """The findings that must be mended."""
        return tuple(finding for finding in self.findings if finding.verdict == "fault")


def check_hand(name_or_path: str | Path) -> HandCheck:
    """Checks a hand of the package by name, or any `*.hand.yaml` by path."""
    try:
        config = load_hand_config(name_or_path)
    except InvalidInputError as error:
        return HandCheck((fault("file", error),))
    with _complaints() as complaints:
        check = _check(config, complaints)
        return dataclasses.replace(check, entries=_entries(config, check))


def _entries(config: HandConfig, check: HandCheck) -> tuple[Entry, ...]:
    """The findings' entries, and the surfaces of fingertips that are found where these say."""
    entries = tuple(entry for finding in check.findings for entry in finding.entries)
    structure = [entry for entry in entries if entry.key in _STRUCTURE]
    if not structure:
        return entries
    mended = copy.deepcopy(config)
    for entry in structure:
        setattr(
            mended.finger(entry.finger), entry.key, entry.value if isinstance(entry.value, str) else list(entry.value)
        )
    try:
        findings = _check(mended, []).findings
    except InvalidInputError:
        return entries
    surfaces = [entry for finding in findings for entry in finding.entries if entry.key == "surface"]
    return (*structure, *surfaces)


def _check(config: HandConfig, complaints: list[str]) -> HandCheck:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    leave_friction_out(scene_graph)
    try:
        hand = add_fixed_hand(plant, config)
        plant.Finalize()
    except (InvalidInputError, RuntimeError) as error:
        builder.Build()
        return HandCheck((fault("model", error),))
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    findings = (
        *_model(plant, scene_graph, hand, tuple(complaints)),
        *check_joints(plant, hand),
        *check_couplings(plant, hand),
        *check_fingertips(plant, scene_graph, hand),
        *_contact(plant, scene_graph, hand, context),
        *_dynamics(plant, hand, context),
        *check_pads(plant, scene_graph, hand),
        _uncertainty(config),
        *_calibration(config),
    )
    unlimited = any(has_unlimited_joints(plant, hand, finger) for finger in config.fingers if finger.sensor_frame)
    if not unlimited and not any(finding.verdict == "fault" and finding.part != "contact" for finding in findings):
        findings += tuple(_reach(config))
    return HandCheck(findings, CheckedHand(diagram, plant, hand))


class _complaints(logging.Handler):  # noqa: N801  It is used as a function.
    """Collects all that Drake logs while it reads a model, also what filters keep from a terminal."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())

    def __enter__(self) -> list[str]:
        self._logger = logging.getLogger("drake")
        self._state = self._logger.level, self._logger.propagate, self._logger.filters
        self._logger.addHandler(self)
        self._logger.filters = []
        self._logger.setLevel(logging.WARNING)
        self._logger.propagate = False
        return self.messages

    def __exit__(self, *_: object) -> None:
        self._logger.removeHandler(self)
        level, self._logger.propagate, self._logger.filters = self._state
        self._logger.setLevel(level)


def _model(
    plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, complaints: tuple[str, ...]
) -> Iterator[Finding]:
    inspector, instance = scene_graph.model_inspector(), hand.model_instance
    shapes = [
        (
            plant.get_body(index).name(),
            len(inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), Role.kProximity)),
        )
        for index in plant.GetBodyIndices(instance)
    ]
    count = sum(number for _, number in shapes)
    yield Finding("model", f"{len(shapes)} links with {count} collision shapes", "ok" if count else "fault")
    yield from _too_far(plant, scene_graph, hand)
    bare = [name for name, number in shapes if not number]
    if bare and count:
        yield Finding("model", f"no collision shape, so no part of the hand's volume: {', '.join(bare)}", "note")
    kinds = Counter(map(complaint_kind, complaints))
    firsts = {complaint_kind(message): message for message in reversed(complaints)}
    for kind, count in kinds.items():
        # The model is known: its name is enough.
        text = " ".join(firsts[kind].replace(f"{Path(hand.config.model).parent}/", "").split()).removesuffix(".")
        yield Finding("model", f"Drake says{_times(count)}: {text}", "note")
    P = hand.palm_frame
    yield Finding(
        "palm", f"frame {P.name()!r} on link {P.body().name()!r}; the link {hand.config.base_link!r} carries it"
    )
    if pose_by_model(hand.config) is not None:
        text = (
            f"the model itself fixes {hand.config.base_link!r} to the world; a scenario's X_WBase must be that pose, "
            "and an arm cannot carry it"
        )
        yield Finding("palm", text, "note")
    moved = joints_towards(plant, hand, P, hand.config.base_link)
    if moved:
        yield Finding(
            "palm", f"is moved by {', '.join(moved)}: joints beside the fingers' must be measured too", "note"
        )


def _too_far(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand) -> Iterator[Finding]:
    """Links whose shapes reach farther than any hand does: of other units, such as millimetres."""
    spheres = BodySpheres.from_inspector(plant, scene_graph.model_inspector(), hand.model_instance)
    reach = np.linalg.norm(HandKinematics(plant, hand.palm_frame).positions(spheres), axis=1) + spheres.radius
    for body in np.unique(spheres.body[reach > _FARTHEST]):
        name = plant.get_body(BodyIndex(body)).name()
        text = f"the collision shapes of {name!r} reach {reach[spheres.body == body].max():.3g} m from the palm"
        yield Finding("model", f"{text}; allowed are up to {_FARTHEST:g} m", "fault")


def _times(count: int) -> str:
    return f" of {count} places" if count > 1 else ""


def _contact(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, context: Context) -> Iterator[Finding]:
    inspector, instance = scene_graph.model_inspector(), hand.model_instance
    rigid, unsaid = rigid_shapes(plant, inspector, instance), unsaid_shapes(plant, inspector, instance)
    if rigid:
        text = f"rigid, so that it cannot touch a rigid object in hydroelastic contact: {', '.join(rigid)}"
        yield Finding("contact", text, "fault")
    if unsaid:
        text = f"{len(unsaid)} shapes do not say whether they are compliant; the simulation takes them for hard rubber"
        yield Finding("contact", text, "note")
    if not rigid and not unsaid:
        yield Finding("contact", "all shapes are compliant")
    pairs = self_collisions(plant, context, instance)
    if pairs:
        text = "at zero joint positions overlap, and pass through each other in the simulation: "
        yield Finding("contact", text + ", ".join(f"{a} and {b}" for a, b in pairs), "note")
    else:
        yield Finding("contact", "no two links overlap at zero joint positions")


def _dynamics(plant: MultibodyPlant, hand: Hand, context: Context) -> Iterator[Finding]:
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(hand.model_instance)]
    light = [joint for joint in joints if joint.num_positions() and not joint.child_body().get_mass(context) > 0.0]
    bare = [joint.child_body().name() for joint in light if not _carried(plant, joint, context) > 0.0]
    carrying = [joint.child_body().name() for joint in light if joint.child_body().name() not in bare]
    if bare:
        text = f"links without a mass, which can be posed but not simulated: {', '.join(bare)}"
        yield Finding("dynamics", text, "note")
    if carrying:
        text = f"links without a mass, which are simulated with that of what they carry: {', '.join(carrying)}"
        yield Finding("dynamics", text, "note")
    replaced = [
        body.name() for body in map(plant.get_body, plant.GetBodyIndices(hand.model_instance)) if _is_water(body)
    ]
    if replaced:
        text = (
            "links whose inertia in the file no body has, as one without a mass, and that Drake takes for balls of "
            f"1 kg: {', '.join(replaced)}"
        )
        yield Finding("dynamics", text, "note")
    elif not light:
        yield Finding(
            "dynamics", f"all links have masses, {plant.CalcTotalMass(context, [hand.model_instance]):.3g} kg in all"
        )
    driven = {name for finger in hand.config.fingers for name in finger.joints}
    damping = max((float(np.max(j.default_damping_vector())) for j in joints if j.name() in driven), default=0.0)
    if damping > _SLOWEST * _STIFFNESS:
        stiffness = f"{damping / 0.1:g}"
        text = (
            f"joint damping of up to {damping:g} N m s/rad lets the fingers close slowly; give the scenario "
            f"`reach: {{stiffness: {stiffness}}}` and `controller: {{finger_stiffness: {stiffness}}}`, N m/rad"
        )
        yield Finding("dynamics", text, "note")


def _is_water(body: RigidBody) -> bool:
    """Whether a body's inertia is that which Drake takes in place of one that cannot be: a kilogram of water."""
    water = SpatialInertia.SolidSphereWithMass(1.0, (0.75e-3 / math.pi) ** (1.0 / 3.0))
    return np.allclose(
        body.default_spatial_inertia().CopyToFullMatrix6(), water.CopyToFullMatrix6(), rtol=0.0, atol=1e-9
    )


def _carried(plant: MultibodyPlant, joint: Joint, context: Context) -> float:
    """The mass of all that a joint moves, kg."""
    bodies = plant.GetBodiesKinematicallyAffectedBy([joint.index()])
    return sum(float(plant.get_body(index).get_mass(context)) for index in bodies)


def _reach(config: HandConfig) -> Iterator[Finding]:
    try:
        reach = make_hand_reach(config, ReachParams())
    except InvalidInputError as error:
        can_plan = sum(bool(finger.sensor_frame) for finger in config.fingers) > 1
        yield Finding("reach", fault("", error).text, "fault" if can_plan else "note")
        return
    for name, finger in reach.fingers.items():
        low, high = finger.reached.min(axis=0), finger.reached.max(axis=0)
        yield Finding(f"finger {name}", f"its fingertip reaches {_box(low, high)} in the palm frame")
    source = "its file's" if config.grip_low else "found, as its file names none"
    yield Finding("grip", f"region where it holds things ({source}): {_box(reach.grip_low, reach.grip_high)}")


def _box(low: np.ndarray, high: np.ndarray) -> str:
    sides = zip("xyz", 1e3 * low, 1e3 * high, strict=True)
    return ", ".join(f"{axis} {a:z.0f} to {b:z.0f}" for axis, a, b in sides) + " mm"


def _uncertainty(config: HandConfig) -> Finding:
    told = config.uncertainty
    if told is None:
        text = (
            "is not declared, so that contacts are as certain as parameters say; `{}` declares a good research hand's"
        )
        return Finding("uncertainty", text, "note")
    return Finding(
        "uncertainty",
        f"encoders {told.encoder_offset_deg:g} deg; mounting {1e3 * told.mounting:g} mm, {told.mounting_deg:g} deg; "
        f"fingertips {1e3 * told.fingertip_radius:g} mm; sensors {told.sensor_force:g} N, "
        f"{1e3 * told.sensor_moment:g} mN m",
    )


def _calibration(config: HandConfig) -> Iterator[Finding]:
    if not config.calibration:
        return
    try:
        make_hand_plant(config)
    except InvalidInputError as error:
        yield fault("calibration", error)
    else:
        yield Finding("calibration", f"{Path(config.calibration).name} is of the hand's joints and fingers")
