"""A simulated array of pressure cells on a soft pad."""

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import Context, EventStatus, State

from tactopose_drake.core.sensing.rubber_layer import cell_response, confined_pressure, find_neighbours
from tactopose_drake.core.sensing.tactile_array import PressureField, mean_pressure, read_cells, spread_matrix
from tactopose_drake.core.validation import instance_of
from tactopose_drake.drivers.device import NO_SAMPLE
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_pressure import pressure_field
from tactopose_drake.hand.tactile_pads import TactilePad
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input
from tactopose_drake.systems.sample_time import SampleTime

POINT_CONTACT = "a point contact is not felt"


class TactileArray(CollectableSystem):
    """Measures the pressure on the cells of a pad, from the simulator's hydroelastic contact.

    Each cell averages the normal pressure over its own area. The soft layer spreads it to neighbouring cells, with a
    rubber model if the array's file has one; then noise, range, quantisation and dead cells are applied.

    .. pydrake_system::

        name: TactileArray
        input_ports:
        - contact_results
        - body_poses
        - noise
        output_ports:
        - pressures
        - status

    - contact_results: `ContactResults`, the plant's port of that name.
    - body_poses: list of `RigidTransform` X_WB, the plant's port of that name; only the pad's pose is used. If the
      plant samples its contact results, they are one time step older than this pose.
    - noise: random input, a standard normal number for each cell (`AddRandomInputs` connects it); zero when not
      connected.
    - pressures: pressure on each cell, Pa, >= 0. Changes once a period, first a period after the start, since a
      discrete plant may have no contact results before its first step. NaN before that, also once the clock has been
      set back, where a cell is dead, and, while a point contact, which has no pressure field, is on the pad, where a
      cell feels nothing else.
    - status: str, "ok", "no contact", "no sample yet", or "saturated: " and the cells; ends with "a point contact is
      not felt" while one is on the pad, as of shapes that are not compliant, or of the point contact model. Changes
      with `pressures`.
    """

    def __init__(self, plant: MultibodyPlant, pad_frame: Frame, pad: TactilePad) -> None:
        """Takes numbers from a finalized plant; keeps no reference to it.

        Args:
            plant: finalized plant.
            pad_frame: T, the frame of the pad's layout, fixed on the body whose collision geometry is the pad. All
                contact on that body counts as contact on the pad.
            pad: cells, limits and period; `load_tactile_pad` reads one.

        Raises:
            InvalidInputError: if the body has no collision geometry, or a parameter is out of its range.
        """
        super().__init__()
        instance_of("plant", plant, MultibodyPlant)
        instance_of("pad_frame", pad_frame, Frame)
        instance_of("pad", pad, TactilePad)
        pad.model.validate(len(pad.layout))
        body = pad_frame.body()
        # Plain integers, because Drake's identifiers would keep the plant alive.
        self._geometries = {geometry.get_value() for geometry in plant.GetCollisionGeometriesForBody(body)}
        if not self._geometries:
            raise InvalidInputError(
                "pad_frame must be a frame of a body with collision geometry to be touched (in a URDF <frame link= "
                f"name= xyz= rpy=/>, in an SDF <frame attached_to=>), not {pad_frame.name()!r}, whose body "
                f"{body.name()!r} has none."
            )
        self._pad, self._body = pad, body.index()
        self._X_BT = pad_frame.GetFixedPoseInBodyFrame()
        self._spread = spread_matrix(pad.layout, pad.model.spread)
        rubber = pad.model.rubber
        self._rubber = None if rubber is None else (rubber, find_neighbours(pad.layout))
        self._contacts = self.DeclareAbstractInputPort("contact_results", AbstractValue.Make(ContactResults()))
        self._body_poses = self.DeclareAbstractInputPort("body_poses", AbstractValue.Make([RigidTransform()]))
        self._noise = self.DeclareVectorInputPort("noise", len(pad.layout), RandomDistribution.kGaussian)
        self._pressures = self.DeclareDiscreteState(np.full(len(pad.layout), np.nan))
        # The largest pressure since each cell was touched, Pa.
        self._peaks = self.DeclareDiscreteState(np.zeros(len(pad.layout)))
        self._status = self.DeclareAbstractState(AbstractValue.Make(NO_SAMPLE))
        self._sampled = SampleTime(self, pad.period)
        self.DeclarePeriodicUnrestrictedUpdateEvent(pad.period, pad.period, self._sample)
        self.DeclareStateOutputPort("pressures", self._pressures)
        self.DeclareStateOutputPort("status", self._status)

    def _sample(self, context: Context, state: State) -> EventStatus:
        if self._sampled.is_early(context):
            return EventStatus.DidNothing()
        self._sampled.note(context, state)
        results = eval_input(self._contacts, context, ContactResults)
        X_WB = eval_input(self._body_poses, context, list)[self._body]
        noise = self._noise.Eval(context) if self._noise.HasValue(context) else np.zeros(len(self._pad.layout))

        pressure = mean_pressure(self._pad.layout, self._fields(results, X_WB @ self._X_BT))
        if self._rubber is not None:
            rubber, neighbours = self._rubber
            pressure = confined_pressure(pressure, neighbours, rubber.confinement)
        pressure = self._spread @ pressure
        if self._rubber is not None:
            before = context.get_discrete_state(self._peaks).value()
            peaks = np.where(pressure > 0.0, np.maximum(before, pressure), 0.0)
            state.get_mutable_discrete_state(self._peaks).SetFromVector(peaks)
            pressure = cell_response(pressure, peaks, rubber)
        frame = read_cells(pressure, noise, self._pad.model)
        reading, status = frame.pressure, frame.status
        if self._has_point_contact(results):
            # It is unknown which cells it presses on; zero would mean no contact.
            felt = pressure > 0.0
            reading = np.where(felt, reading, np.nan)
            status = f"{status}; {POINT_CONTACT}" if felt.any() else POINT_CONTACT
        state.get_mutable_discrete_state(self._pressures).SetFromVector(reading)
        state.get_mutable_abstract_state(self._status).set_value(status)
        return EventStatus.Succeeded()

    def _fields(self, results: ContactResults, X_WT: RigidTransform) -> list[PressureField]:
        """The pressure of each contact surface on the pad, in T."""
        X_TW = X_WT.inverse()
        fields = []
        for i in range(results.num_hydroelastic_contacts()):
            surface = results.hydroelastic_contact_info(i).contact_surface()
            for geometry, pad_is_M in ((surface.id_M(), True), (surface.id_N(), False)):
                if geometry.get_value() in self._geometries:
                    fields.append(pressure_field(surface, X_TW, pad_is_M=pad_is_M))
        return fields

    def _has_point_contact(self, results: ContactResults) -> bool:
        pairs = (results.point_pair_contact_info(i) for i in range(results.num_point_pair_contacts()))
        return any(self._body in (pair.bodyA_index(), pair.bodyB_index()) for pair in pairs)
