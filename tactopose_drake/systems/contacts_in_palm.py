"""The transformation of contacts from the fingertips into the palm frame."""

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context

from tactopose_drake.core.evidence.contacts import MOST_SIGMA_POSITION, SIGMA_LIMITS, Contacts
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution
from tactopose_drake.core.validation import FloatArray, instance_of, positive_number
from tactopose_drake.hand.contact_uncertainty import LEAST_COVARIANCE, ContactUncertainty
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.hand_kinematics import declare_kinematics
from tactopose_drake.systems.ports import eval_named

_ACCELERATED = "its own acceleration explains the force"


@dataclasses.dataclass(kw_only=True, slots=True)
class ContactsInPalmParams:
    """Uncertainty of the contacts, from sensors and kinematics together."""

    sigma_position: float = 0.0009  # standard deviation of each coordinate, m
    sigma_normal_deg: float = 5.0  # standard deviation of the normal about each axis, deg

    def validate(self) -> None:
        """Raises InvalidInputError if a value is beyond the limits of `Contacts`."""
        (least, _, _), most, name = SIGMA_LIMITS["sigma_position"], MOST_SIGMA_POSITION, "ContactsInPalmParams"
        positive_number(f"{name}.sigma_position", self.sigma_position, least=least, most=most, unit="m")
        least, most = map(math.degrees, SIGMA_LIMITS["sigma_normal"][:2])
        positive_number(f"{name}.sigma_normal_deg", self.sigma_normal_deg, least=least, most=most, unit="deg")


@dataclasses.dataclass(frozen=True)
class _Touch:
    """The values of the output ports."""

    contacts: Contacts
    fingers_in_contact: tuple[str, ...]
    fingers_untouched: tuple[str, ...]
    status: str


class ContactsInPalm(CollectableSystem):
    """Transforms each fingertip's contact into the palm frame, by the measured joint positions.

    .. pydrake_system::

        name: ContactsInPalm
        input_ports:
        - joint_positions
        - contact_solutions
        - inertial_forces
        output_ports:
        - contacts
        - fingers_in_contact
        - fingers_untouched
        - status

    - joint_positions: measured positions of the hand's joints, shape (nq,) of the hand's own plant, rad; NaN where
      unknown. A finger that is moved by an unknown joint, or by one far beyond its limits, gives no contact.
    - contact_solutions: dict of `ContactSolution` by finger.
    - inertial_forces: dict of arrays by finger, see `FingertipInertia`. A force no larger than the component of one of
      these along it is no contact. May stay unconnected.
    - contacts: `Contacts` in P of the fingers whose solution is valid, with normals and forces; changes with the
      inputs. Normals point out of the object, opposite to the fingertip's own.
    - fingers_in_contact: tuple of the fingers' names, in the order of the rows of `contacts`.
    - fingers_untouched: tuple of the names of the fingers whose sensor says that nothing touches them. A finger without
      a reading, or with a wrench that its acceleration or no single contact explains, is in neither tuple.
    - status: str, "ok", or each finger that gives no contact and why.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        sensor_frames: Mapping[str, Frame],
        palm_frame: Frame,
        params: ContactsInPalmParams | None = None,
        uncertainty: ContactUncertainty | None = None,
    ) -> None:
        """Keeps a reference to the plant.

        Args:
            plant: finalized plant of the hand alone, for kinematics; not the simulator's.
            sensor_frames: the frame S of each finger's contact solution, by finger.
            palm_frame: P.
            params: standard deviations.
            uncertainty: the hand's errors, from which each contact's covariance is computed, in place of `params`.
        """
        super().__init__()
        instance_of("plant", plant, MultibodyPlant)
        instance_of("sensor_frames", sensor_frames, Mapping)
        instance_of("palm_frame", palm_frame, Frame)
        self._uncertainty = uncertainty
        self._params = params_of(ContactsInPalmParams, params)
        self._sensor_frames = dict(sensor_frames)
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._solutions = self.DeclareAbstractInputPort("contact_solutions", AbstractValue.Make({}))
        self._inertial = self.DeclareAbstractInputPort("inertial_forces", AbstractValue.Make({}))
        self._kinematics = declare_kinematics(self, plant, palm_frame, self._positions)
        needs = {self._kinematics.ticket(), self._solutions.ticket(), self._inertial.ticket()}
        self._touch = self.declare_value("contacts in the palm", self._calc_touch, needs)
        empty, touch = _Touch(Contacts.empty(), (), (), ""), {self._touch.ticket()}
        for name in (field.name for field in dataclasses.fields(_Touch)):
            self.declare_output(name, getattr(empty, name), functools.partial(self._part, name), touch)

    def _part(self, name: str, context: Context) -> Any:
        return getattr(self._touch.Eval(context), name)

    def _calc_touch(self, context: Context) -> _Touch:
        kinematics = self._kinematics.Eval(context)
        X_PS = kinematics.poses(self._sensor_frames)
        solutions = self._read_solutions(context, X_PS)
        fingers = tuple(finger for finger in X_PS if finger in solutions and solutions[finger].valid)
        p_PC, n_PC, f_PC = _move([X_PS[finger] for finger in fingers], [solutions[finger] for finger in fingers])
        covariance = None
        if self._uncertainty is not None:
            each = [self._uncertainty.covariance(f, solutions[f], X_PS[f], kinematics) for f in fingers]
            covariance = np.array(each).reshape(-1, 6, 6) + LEAST_COVARIANCE
        contacts = Contacts(
            p_PC,
            n_PC,
            f_PC,
            sigma_position=self._params.sigma_position,
            sigma_normal=math.radians(self._params.sigma_normal_deg),
            covariance=covariance,
        )
        untouched = tuple(finger for finger in X_PS if finger in solutions and solutions[finger].is_untouched)
        reasons = {
            finger: _reason(finger, solutions) if finger in X_PS else kinematics.fault(frame)
            for finger, frame in self._sensor_frames.items()
        }
        status = "; ".join(f"{finger}: {reason}" for finger, reason in reasons.items() if reason) or "ok"
        return _Touch(contacts, fingers, untouched, status)

    def _read_solutions(self, context: Context, X_PS: Mapping[str, RigidTransform]) -> dict[str, ContactSolution]:
        """The solutions; those whose force the finger's own acceleration explains are not valid."""
        solutions = dict(eval_named(self._solutions, context, ContactSolution))
        forces = eval_named(self._inertial, context, np.ndarray) if self._inertial.HasValue(context) else {}
        for finger in X_PS.keys() & solutions.keys() & forces.keys():
            solution = solutions[finger]
            f_P = X_PS[finger].rotation() @ (solution.normal_force + solution.friction_force)
            if solution.valid and f_P @ f_P <= np.max(forces[finger] @ f_P):
                solutions[finger] = dataclasses.replace(solution, valid=False, reason=_ACCELERATED)
        return solutions


def _move(X_PS: list[RigidTransform], solutions: list[ContactSolution]) -> FloatArray:
    """Positions, the object's outward normals and the forces on the fingertips, in P, shape (3, k, 3)."""
    X = np.array([X.GetAsMatrix34() for X in X_PS]).reshape(-1, 3, 4)
    rows_S = [(each.p_SC, -each.n_S, each.normal_force + each.friction_force) for each in solutions]
    rows_P = np.array(rows_S).reshape(-1, 3, 3) @ np.swapaxes(X[:, :, :3], 1, 2)
    rows_P[:, 0] += X[:, :, 3]
    return np.swapaxes(rows_P, 0, 1)


def _reason(finger: str, solutions: Mapping[str, ContactSolution]) -> str:
    """Why a finger whose joints are known gives no contact; empty where it does."""
    return solutions[finger].reason if finger in solutions else "no solution"
