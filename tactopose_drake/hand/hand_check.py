"""Checks of a hand's files, part by part."""

import copy
import dataclasses
import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_properties import leave_friction_out
from tactopose_drake.hand.coupling_check import check_couplings
from tactopose_drake.hand.findings import Entry, Finding, fault
from tactopose_drake.hand.fingertip_check import check_fingertips
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, add_fixed_hand, make_hand_plant
from tactopose_drake.hand.hand_reach import make_hand_reach
from tactopose_drake.hand.joint_check import check_joints, has_unlimited_joints
from tactopose_drake.hand.model_check import check_model
from tactopose_drake.hand.pad_check import check_pads
from tactopose_drake.hand.simulation_check import check_simulation

_STRUCTURE = ("joints", "couplings", "sensor_frame", "weld")  # keys of a finger on which its surface depends


@dataclasses.dataclass(frozen=True, eq=False)
class CheckedHand:
    """A hand alone, its base fixed, in a plant with its geometry."""

    diagram: Diagram
    plant: MultibodyPlant
    hand: Hand


@dataclasses.dataclass(frozen=True, eq=False)
class HandCheck:
    """The findings, part by part, and the checked hand; None if its files do not describe one.

    `entries` are suggested entries for the hand's file: those of the findings, and those that follow from them.
    """

    findings: tuple[Finding, ...]
    parts: CheckedHand | None = None
    entries: tuple[Entry, ...] = ()

    @property
    def faults(self) -> tuple[Finding, ...]:
        """The findings that must be fixed."""
        return tuple(finding for finding in self.findings if finding.verdict == "fault")


def check_hand(name_or_path: str | Path) -> HandCheck:
    """Checks a hand of the package by name, or any `*.hand.yaml` by path."""
    try:
        config = load_hand_config(name_or_path)
    except InvalidInputError as error:
        return HandCheck((fault("file", error),))
    with _Complaints() as complaints:
        check = _check(config, complaints)
        return dataclasses.replace(check, entries=_entries(config, check))


def _entries(config: HandConfig, check: HandCheck) -> tuple[Entry, ...]:
    """The findings' entries, and the fingertip surfaces that are found once the structural entries are applied."""
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
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, plant=MultibodyPlant(time_step=0.001))
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
        *check_model(plant, scene_graph, hand, tuple(complaints)),
        *check_joints(plant, hand),
        *check_couplings(plant, hand),
        *check_fingertips(plant, scene_graph, hand),
        *check_simulation(plant, scene_graph, hand, context),
        *check_pads(plant, scene_graph, hand),
        _uncertainty(config),
        *_calibration(config),
    )
    unlimited = any(has_unlimited_joints(plant, hand, config.finger(name)) for name in config.sensing)
    if not unlimited and not any(finding.verdict == "fault" and finding.part != "contact" for finding in findings):
        findings += tuple(_reach(config))
    return HandCheck(findings, CheckedHand(diagram, plant, hand))


class _Complaints(logging.Handler):
    """Collects Drake's warnings while it reads a model, including those that filters hide from the terminal."""

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


def _reach(config: HandConfig) -> Iterator[Finding]:
    try:
        reach = make_hand_reach(config, ReachParams())
    except InvalidInputError as error:
        can_plan = len(config.sensing) > 1
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
