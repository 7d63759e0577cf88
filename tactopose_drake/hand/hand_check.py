"""What is right and wrong with a hand's files, part by part."""

import logging
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import Role, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_properties import rigid_shapes, self_collisions, unsaid_shapes
from tactopose_drake.hand.coupling_check import check_couplings
from tactopose_drake.hand.findings import Finding, Verdict, fault
from tactopose_drake.hand.finger_chain import finger_chain, joints_towards
from tactopose_drake.hand.fingertip_fit import fingertip_fit
from tactopose_drake.hand.fingertip_outline import fit_fingertip
from tactopose_drake.hand.hand_config import FingerConfig, HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_hand
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import complaint_kind

_SLOWEST = 0.5  # s that a joint's damping may take to let the default grasp controller's spring close it
_LIES_ON_IT = 0.95  # share of a fingertip's surface within 1 mm of the shapes from which on no other is sought
_FAR_BETTER, _GOOD_ENOUGH = 1.5, 5e-4  # of fingertip surfaces: ratio of residuals, and a residual, m
_STIFFNESS = ReachParams().stiffness  # N m/rad


@dataclass(frozen=True, eq=False)
class CheckedHand:
    """A hand alone, its base fixed, in a plant with its geometry."""

    diagram: Diagram
    plant: MultibodyPlant
    scene_graph: SceneGraph
    hand: Hand


@dataclass(frozen=True, eq=False)
class HandCheck:
    """What was found, part by part, and the hand that it was found of; None where its files do not give one."""

    findings: tuple[Finding, ...]
    parts: CheckedHand | None = None

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
        return _check(config, complaints)


def _check(config: HandConfig, complaints: list[str]) -> HandCheck:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    try:
        hand = add_hand(plant, config, RigidTransform())
        plant.Finalize()
    except (InvalidInputError, RuntimeError) as error:
        builder.Build()
        return HandCheck((fault("model", error),))
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    findings = (
        *_model(plant, scene_graph, hand, tuple(complaints)),
        *_joints(plant, hand),
        *check_couplings(plant, hand),
        *_fingertips(plant, scene_graph, hand),
        *_contact(plant, scene_graph, hand, context),
        *_dynamics(plant, hand, context),
        *_reach(config),
        *_pads(config),
    )
    return HandCheck(findings, CheckedHand(diagram, plant, scene_graph, hand))


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
    bare = [name for name, number in shapes if not number]
    if bare and count:
        yield Finding("model", f"no collision shape, so no part of the hand's volume: {', '.join(bare)}", "note")
    for kind, count in Counter(map(complaint_kind, complaints)).items():
        yield Finding("model", f"Drake says{_times(count)}: {' '.join(kind.split())}", "note")
    P = hand.palm_frame
    yield Finding(
        "palm", f"frame {P.name()!r} on link {P.body().name()!r}; the link {hand.config.base_link!r} carries it"
    )
    moved = joints_towards(plant, hand, P, hand.config.base_link)
    if moved:
        yield Finding(
            "palm", f"is moved by {', '.join(moved)}: joints beside the fingers' must be measured too", "note"
        )


def _times(count: int) -> str:
    return f" of {count} places" if count > 1 else ""


def _joints(plant: MultibodyPlant, hand: Hand) -> Iterator[Finding]:
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(hand.model_instance)]
    moving = sorted((joint.position_start(), joint.name()) for joint in joints if joint.num_positions())
    yield Finding("joints", f"order of joint_positions: {', '.join(name for _, name in moving)}")
    for finger in hand.config.fingers:
        part = f"finger {finger.name}"
        if not finger.sensor_frame:
            yield Finding(part, "has no force-torque sensor: it takes no part in planned grasps", "note")
            continue
        try:
            chain = finger_chain(plant, hand, finger.name)
        except InvalidInputError as error:
            yield fault(part, error)
            continue
        yield from _order(plant, hand, finger)
        span = [
            f"{name} {low:.3g} to {high:.3g}"
            for name, low, high in zip(finger.joints, chain.lower, chain.upper, strict=True)
        ]
        limited = bool(np.all(np.isfinite([*chain.lower, *chain.upper])) and np.all(chain.upper > chain.lower))
        text = f"joint limits: {', '.join(span)}"
        yield Finding(
            part, text if limited else f"{text}; planned grasps need finite ones", "ok" if limited else "fault"
        )


def _order(plant: MultibodyPlant, hand: Hand, finger: FingerConfig) -> Iterator[Finding]:
    path = joints_towards(plant, hand, hand.sensor_frames[finger.name])
    follows = {coupling.joint: coupling.follows for coupling in finger.couplings}
    order = list(dict.fromkeys(follows.get(name, name) for name in path))
    if order == finger.joints:
        yield Finding(f"finger {finger.name}", f"its joints lead from the palm outwards: {', '.join(path)}")
    else:
        text = f"its joints are {', '.join(finger.joints)}; from the palm outwards they are {', '.join(order)}"
        yield Finding(f"finger {finger.name}", text, "note")


def _fingertips(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand) -> Iterator[Finding]:
    for finger, frame in hand.sensor_frames.items():
        part, weld = f"fingertip {finger}", hand.welds[finger]
        tip = weld.child_body().name()
        yield Finding(part, f"sensor frame {frame.name()!r} at joint {weld.name()!r}, before link {tip!r}")
        fit = fingertip_fit(plant, scene_graph.model_inspector(), hand, finger)
        if fit is None:
            yield Finding(
                part, f"the link {tip!r} has no collision shape, which its surface could be compared with", "fault"
            )
            continue
        text = (
            f"of its surface {fit.share:.0%} lie within 1 mm of the collision shapes of link {tip!r}; "
            f"the rest is up to {1e3 * fit.above:.1f} mm above and {1e3 * fit.below:.1f} mm below"
        )
        verdict: Verdict = "ok" if fit.share > 0.5 else "note" if fit.share > 0.1 else "fault"
        yield Finding(part, text, verdict)
        if fit.share < _LIES_ON_IT:
            yield from _better_surface(plant, scene_graph, hand, finger)


def _better_surface(plant: MultibodyPlant, scene_graph: SceneGraph, hand: Hand, finger: str) -> Iterator[Finding]:
    """Names a surface that lies far better on the fingertip's shape than the file's."""
    fitted = fit_fingertip(plant, scene_graph.model_inspector(), hand, finger)
    if fitted is None or fitted.own_residual < max(_FAR_BETTER * fitted.residual, _GOOD_ENOUGH):
        return
    text = (
        f"a surface fitted to the shape in which the finger ends is off by {1e3 * fitted.residual:.2f} mm (root mean "
        f"square), the file's by {1e3 * fitted.own_residual:.2f} mm"
    )
    yield Finding(f"fingertip {finger}", text, "note", f"surface: {fitted.yaml}")


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
    moved = [joint.child_body() for joint in joints if joint.num_positions()]
    light = [body.name() for body in moved if not body.get_mass(context) > 0.0]
    if light:
        text = f"links without a mass, which can be posed but not simulated: {', '.join(light)}"
        yield Finding("dynamics", text, "note")
    else:
        yield Finding(
            "dynamics", f"all links have masses, {plant.CalcTotalMass(context, [hand.model_instance]):.3g} kg in all"
        )
    driven = {name for finger in hand.config.fingers for name in finger.joints}
    damping = max((float(np.max(j.default_damping_vector())) for j in joints if j.name() in driven), default=0.0)
    if damping > _SLOWEST * _STIFFNESS:
        text = (
            f"joint damping of up to {damping:g} N m s/rad lets the fingers close slowly; give the scenario's reach "
            f"and controller a stiffness of {damping / 0.1:g} N m/rad"
        )
        yield Finding("dynamics", text, "note")


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
    source = "its file's" if config.grip_low and config.grip_high else "found, as its file names none"
    yield Finding("grip", f"region where it holds things ({source}): {_box(reach.grip_low, reach.grip_high)}")


def _box(low: np.ndarray, high: np.ndarray) -> str:
    sides = zip("xyz", 1e3 * low, 1e3 * high, strict=True)
    return ", ".join(f"{axis} {a:.0f} to {b:.0f}" for axis, a, b in sides) + " mm"


def _pads(config: HandConfig) -> Iterator[Finding]:
    for pad in config.pads:
        try:
            cells = len(load_tactile_pad(pad.array).layout.areas)
        except InvalidInputError as error:
            yield fault(f"pad {pad.name}", error)
            continue
        yield Finding(f"pad {pad.name}", f"{cells} cells of {pad.array} in frame {pad.frame!r}")
