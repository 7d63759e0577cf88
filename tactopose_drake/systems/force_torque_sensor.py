"""A simulated six-axis force-torque sensor between a finger and its fingertip."""

import dataclasses
from pathlib import Path

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.sensing.force_torque import ForceTorqueModel, measure, shift_matrix, weight_matrix
from tactopose_drake.core.validation import instance_of, known_name, positive_number
from tactopose_drake.drivers.device import NO_SAMPLE
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.hand.fingertip_weights import fingertip_mass
from tactopose_drake.resources import load_typed_yaml, sensor_file
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input
from tactopose_drake.systems.sample_time import SampleTime


@dataclasses.dataclass(kw_only=True, slots=True)
class ForceTorqueModelFile:
    """The content of a sensor's YAML file: its calibrations by name."""

    calibrations: dict[str, ForceTorqueModel] = dataclasses.field(default_factory=dict)


def load_force_torque_model(calibration: str = "SI-12-0.12", name_or_path: str | Path = "nano17") -> ForceTorqueModel:
    """Reads one calibration of a force-torque sensor.

    Args:
        calibration: name of the calibration in the file.
        name_or_path: one of the package's sensors by name, or any file by path.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit the format.
        UnknownNameError: if the file has no such calibration.
        InvalidInputError: if a value is out of its range.
    """
    path, calibrations = _read(name_or_path)
    known_name(f"{path}: calibration", calibration, sorted(calibrations))
    model = calibrations[calibration]
    model.validate()
    return model


def sufficient_calibration(force: float, moment: float, name_or_path: str | Path = "nano17") -> str:
    """The calibration with the smallest range that covers a load on every axis; if none does, the one with the largest.

    Args:
        force: N.
        moment: N m.
        name_or_path: one of the package's sensors by name, or any file by path.

    Raises:
        InvalidFileError: if the file cannot be read, does not fit the format, or has no calibration.
    """
    path, calibrations = _read(name_or_path)
    if not calibrations:
        raise InvalidFileError(f"{path}: calibrations must be at least one, not none.")
    load = np.repeat([moment, force], 3)
    spare = {name: float(np.min(np.asarray(model.range) / load)) for name, model in calibrations.items()}
    bearing = {name: share for name, share in spare.items() if share >= 1.0}
    return min(bearing, key=lambda name: bearing[name]) if bearing else max(spare, key=lambda name: spare[name])


def _read(name_or_path: str | Path) -> tuple[Path, dict[str, ForceTorqueModel]]:
    """The file of a sensor, and its calibrations by name."""
    path = sensor_file(name_or_path, "calibrations")
    return path, load_typed_yaml(ForceTorqueModelFile, path).calibrations


class ForceTorqueSensor(CollectableSystem):
    """Measures the wrench that the environment exerts on a fingertip, as the sensor at its base does.

    The load is the reaction at the weld between finger and fingertip. The model applies noise, bias, drift, range and
    quantisation, then subtracts the fingertip's weight, as a calibrated driver does. It does not subtract the
    fingertip's inertial force (mass times acceleration): like the real instrument, the sensor reads it as a load.

    .. pydrake_system::

        name: ForceTorqueSensor
        input_ports:
        - reaction_forces
        - body_poses
        - noise
        output_ports:
        - wrench
        - status

    - reaction_forces: list of `SpatialForce`, the plant's port of that name.
    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name; only the sensor's orientation is used.
    - noise: random input, six standard normal numbers (`AddRandomInputs` connects it); zero when not connected.
    - wrench: F_S = [m_x, m_y, m_z, f_x, f_y, f_z] about the origin of S, in S, N m and N. Changes once a period, first
      a period after the start, since a discrete plant has no reaction before its first step. NaN before that, also once
      the clock has been set back, where the plant gives no reaction, and while the sensor is saturated, as loads beyond
      its range are unknown.
    - status: str, "ok", "no sample yet", "no signal", or "saturated: " and the axes; changes with `wrench`.
    """

    def __init__(
        self, plant: MultibodyPlant, weld: Joint, sensor_frame: Frame, model: ForceTorqueModel, period: float = 0.01
    ) -> None:
        """Takes numbers from a finalized plant; keeps no reference to it.

        Args:
            plant: finalized plant, whose gravity and masses must not change afterwards: a sensor would subtract the
                wrong weight.
            weld: joint between finger (parent) and fingertip (child); S is on the fingertip if it moves.
            sensor_frame: S, fixed on the finger or on the fingertip.
            model: noise, range and quantisation; `load_force_torque_model` reads one.
            period: sampling period, s.

        Raises:
            InvalidInputError: if the sensor frame is fixed to neither, or a number is out of its range.
        """
        super().__init__()
        instance_of("plant", plant, MultibodyPlant)
        instance_of("weld", weld, Joint)
        instance_of("sensor_frame", sensor_frame, Frame)
        instance_of("model", model, ForceTorqueModel)
        model.validate()
        positive_number("period", period)
        self._model = model
        # The plant's reactions skip joints that were removed, while the remaining joints keep their indices.
        self._joint = list(plant.GetJointIndices()).index(weld.index())
        self._body = int(sensor_frame.body().index())
        has_weight = plant.is_gravity_enabled(weld.child_body().model_instance())
        self._g_W = np.array(plant.gravity_field().gravity_vector()) if has_weight else np.zeros(3)

        X_SJ = plant.CalcRelativeTransform(plant.CreateDefaultContext(), sensor_frame, weld.frame_on_child())
        # At rest the finger holds the fingertip against the contact and the weight: the load is minus the reaction.
        self._load_of_reaction = -shift_matrix(X_SJ.GetAsMatrix34())
        R_BS = sensor_frame.GetFixedRotationMatrixInBodyFrame().matrix()
        self._weight_of_gravity = weight_matrix(*fingertip_mass(plant, weld, sensor_frame)) @ R_BS.T

        self._reactions = self.DeclareAbstractInputPort(
            "reaction_forces", AbstractValue.Make([SpatialForce(np.zeros(6))])
        )
        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self._noise = self.DeclareVectorInputPort("noise", 6, RandomDistribution.kGaussian)
        self._wrench = self.DeclareDiscreteState(np.full(6, np.nan))
        self._status = self.DeclareAbstractState(AbstractValue.Make(NO_SAMPLE))
        self._sampled = SampleTime(self, period)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, period, self._sample)
        self.DeclareStateOutputPort("wrench", self._wrench)
        self.DeclareStateOutputPort("status", self._status)

    def _sample(self, context: Context, state: State) -> EventStatus:
        if self._sampled.is_early(context):
            return EventStatus.DidNothing()
        self._sampled.note(context, state)
        F_TipJ_J = eval_input(self._reactions, context, list)[self._joint].get_coeffs()
        R_BW = eval_input(self._body_poses, context, list)[self._body].rotation().inverse()
        noise = self._noise.Eval(context) if self._noise.HasValue(context) else np.zeros(6)
        measurement = measure(self._load_of_reaction @ F_TipJ_J, noise, self._model, context.get_time())
        weight = self._weight_of_gravity @ (R_BW @ self._g_W)
        wrench = np.full(6, np.nan) if measurement.saturated.any() else measurement.F_S - weight
        state.get_mutable_discrete_state(self._wrench).SetFromVector(wrench)
        state.get_mutable_abstract_state(self._status).set_value(measurement.status)
        return EventStatus.Succeeded()
