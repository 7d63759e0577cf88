"""The systems from a hand's sensors to contacts and patches, which estimation and tracking have in common."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from tactopose_drake.core.parameter_checks import check_parts
from tactopose_drake.core.validation import flag
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.hand.contact_uncertainty import ContactUncertainty, PadUncertainty
from tactopose_drake.hand.geometry import BodySpheres
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.systems.contact_solver import ContactSolver, ContactSolverParams
from tactopose_drake.systems.contacts_in_palm import ContactsInPalm, ContactsInPalmParams
from tactopose_drake.systems.hand_volume import HandVolume
from tactopose_drake.systems.measured_joints import MeasuredJoints
from tactopose_drake.systems.patch_descriptor import PatchDescriptor, PatchDescriptorParams
from tactopose_drake.systems.ports import connect_known, export_outputs


@dataclasses.dataclass(kw_only=True, slots=True)
class TouchParams:
    """The parameters of the parts that estimation and tracking have in common."""

    solver: ContactSolverParams = dataclasses.field(default_factory=ContactSolverParams)
    contacts: ContactsInPalmParams = dataclasses.field(default_factory=ContactsInPalmParams)
    patches: PatchDescriptorParams = dataclasses.field(default_factory=PatchDescriptorParams)  # of a hand with pads
    # Whether contacts and patches get the uncertainty declared in the hand's file, if any, in place of the parameters'.
    use_uncertainty: bool = True
    use_hand_volume: bool = True  # whether the hand's volume and untouched fingertips count as evidence
    # Whether an estimation drops hypotheses that collide with the hand, and a belief reduces the weight of modes with
    # the depth of the collision.
    check_collisions: bool = True

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range."""
        for name in ("use_uncertainty", "use_hand_volume", "check_collisions"):
            flag(f"{type(self).__name__}.{name}", getattr(self, name))
        check_parts(self, solver=ContactSolverParams, contacts=ContactsInPalmParams, patches=PatchDescriptorParams)


def add_touch(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    hand: Hand,
    params: TouchParams,
    estimator: LeafSystem,
    refiner: LeafSystem | None = None,
    others: Sequence[LeafSystem] = (),
    collision: HandCollision | None = None,
) -> None:
    """Adds the systems from the sensors to an estimator, and exports the diagram's ports.

    The inputs are `wrench_<finger>`, `pressures_<pad>`, `age_<pad>` and `joint_positions`. The outputs are `contacts`,
    `fingers_in_contact`, `contact_status`, `contact_solutions`, all of the estimator's and, if the hand has pads,
    `patches`, `pads` and `patch_status`.

    Args:
        builder: builder of the diagram, which already has estimator, refiner and others.
        plant: finalized plant of the hand alone, for kinematics.
        hand: the hand in it.
        params: parameters of each part.
        estimator: its inputs are connected to the outputs of the same names.
        refiner: a `JointOffsetRefiner` that corrects the joint positions; None: they are used as measured.
        others: further systems with an input `joint_positions`; one with an output `inertial_forces` gives those.
        collision: a checker that has already read the hand's shapes from its file; None: they are read here.
    """
    solver = _add_solver(builder, hand, params)
    told = hand.config.uncertainty if params.use_uncertainty else None
    errors = None if told is None else ContactUncertainty(plant, hand, told)
    contacts = builder.AddNamedSystem(
        "contacts_in_palm", ContactsInPalm(plant, hand.sensor_frames, hand.palm_frame, params.contacts, errors)
    )
    builder.Connect(solver.GetOutputPort("contact_solutions"), contacts.GetInputPort("contact_solutions"))
    for system in others:
        if system.HasOutputPort("inertial_forces"):
            builder.Connect(system.GetOutputPort("inertial_forces"), contacts.GetInputPort("inertial_forces"))
    posed: list[LeafSystem] = [contacts]
    touch = {name: contacts.GetOutputPort(name) for name in ("contacts", "fingers_in_contact")}
    touch["contact_status"] = contacts.GetOutputPort("status")
    touch["contact_solutions"] = solver.GetOutputPort("contact_solutions")
    if hand.config.pads:
        pad_errors = None if told is None else PadUncertainty(plant, hand, told)
        descriptor = _add_pads(builder, PatchDescriptor(plant, hand, params.patches, pad_errors), hand.config)
        posed.append(descriptor)
        touch |= {name: descriptor.GetOutputPort(name) for name in ("patches", "pads")}
        touch["patch_status"] = descriptor.GetOutputPort("status")
    known = dict(touch)
    if params.use_hand_volume:
        spheres = BodySpheres.of_hand(hand.config) if collision is None else collision.spheres
        volume = builder.AddNamedSystem("hand_volume", HandVolume(plant, hand, spheres, errors))
        posed.append(volume)
        builder.Connect(contacts.GetOutputPort("fingers_untouched"), volume.GetInputPort("fingers_untouched"))
        known |= {name: volume.GetOutputPort(name) for name in ("hand", "untouched")}
    connect_known(builder, known, estimator)
    takers = [system for system in (*posed, *others, estimator) if system.HasInputPort("joint_positions")]
    if refiner is not None:
        takers = _refined(builder, refiner, solver, takers)
    export_joints(builder, plant, hand, takers)
    for name, port in touch.items():
        builder.ExportOutput(port, name)
    export_outputs(builder, estimator)


def _add_solver(builder: DiagramBuilder, hand: Hand, params: TouchParams) -> ContactSolver:
    """Adds the contact solver, and exports its wrench inputs."""
    found = {} if hand.calibration is None else hand.calibration.fingers
    biases = {finger: calibration.bias for finger, calibration in found.items()}
    solving = ContactSolver(hand.surfaces, params.solver, hand.layers, biases)
    solver: ContactSolver = builder.AddNamedSystem("contact_solver", solving)
    for finger in hand.sensor_frames:
        builder.ExportInput(solver.GetInputPort(f"wrench_{finger}"), f"wrench_{finger}")
    return solver


def _add_pads(builder: DiagramBuilder, describing: PatchDescriptor, hand: HandConfig) -> PatchDescriptor:
    """Adds the patch descriptor, and exports its inputs of pressures and ages."""
    descriptor: PatchDescriptor = builder.AddNamedSystem("patch_descriptor", describing)
    for port in (f"{what}_{pad.name}" for pad in hand.pads for what in ("pressures", "age")):
        builder.ExportInput(descriptor.GetInputPort(port), port)
    return descriptor


def _refined(
    builder: DiagramBuilder, refiner: LeafSystem, solver: LeafSystem, takers: list[LeafSystem]
) -> list[LeafSystem]:
    """Connects the refined joint positions to the takers; returns the systems that take the measured ones."""
    builder.Connect(solver.GetOutputPort("contact_solutions"), refiner.GetInputPort("contact_solutions"))
    for system in takers:
        builder.Connect(refiner.GetOutputPort("joint_positions"), system.GetInputPort("joint_positions"))
    return [refiner]


def corrected_joints(plant: MultibodyPlant, hand: Hand) -> MeasuredJoints:
    """A system that subtracts the offsets found by the hand's calibration from joint positions."""
    return MeasuredJoints(np.eye(plant.num_positions()), -reading_offsets(plant, hand))


def export_joints(builder: DiagramBuilder, plant: MultibodyPlant, hand: Hand, takers: Sequence[LeafSystem]) -> None:
    """Exports the input of joint positions, from which the offsets found by a calibration are subtracted."""
    if hand.calibration is None:
        builder.ExportInput(takers[0].GetInputPort("joint_positions"), "joint_positions")
        for system in takers[1:]:
            builder.ConnectInput("joint_positions", system.GetInputPort("joint_positions"))
    else:
        corrected = builder.AddNamedSystem("corrected_joints", corrected_joints(plant, hand))
        builder.ExportInput(corrected.GetInputPort("measured"), "joint_positions")
        for system in takers:
            builder.Connect(corrected.GetOutputPort("joint_positions"), system.GetInputPort("joint_positions"))
