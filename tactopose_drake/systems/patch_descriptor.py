"""The conversion of pressures on a hand's tactile arrays to contact patches in the palm."""

import dataclasses

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.validation import FloatArray, positive_number
from tactopose_drake.drivers.device import stale
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.contact_uncertainty import PadUncertainty
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.tactile_pads import TactilePad, load_tactile_pad
from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.hand_kinematics import declare_kinematics

NO_READING = "no reading"

# An active cell exceeds this many standard deviations of noise: with 24 cells, noise alone does so in 1 of 1300 frames.
_NOISES = 4.0


@dataclasses.dataclass(kw_only=True, slots=True)
class PatchDescriptorParams:
    """Thresholds that decide which cells feel the object.

    An active cell also exceeds four standard deviations of its array's noise.
    """

    threshold: float = 1000.0  # a cell is active above this pressure, Pa
    # ... and above this share of its pad's highest pressure, as the soft layer spreads up to that share onto cells
    # that the object does not touch.
    threshold_share: float = 0.15
    max_age: float = 0.15  # frames older than this are stale, s; at least the period of each array

    def validate(self) -> None:
        """Raises InvalidInputError if the threshold is negative, the share not below 1, or the age not positive."""
        positive_number("PatchDescriptorParams.max_age", self.max_age)
        positive_number("PatchDescriptorParams.threshold", self.threshold, allow_zero=True)
        if not 0 <= self.threshold_share < 1:
            raise InvalidInputError(
                f"PatchDescriptorParams.threshold_share must be a number >= 0 and < 1, not {self.threshold_share:g}."
            )


@dataclasses.dataclass(frozen=True, eq=False)
class _Described:
    """A pad's patch (None if unknown), and a remark on it for the status, which may be empty."""

    patch: Patch | None
    remark: str


class PatchDescriptor(CollectableSystem):
    """Describes what each tactile pad of a hand feels, in the palm, by the measured joint positions.

    .. pydrake_system::

        name: PatchDescriptor
        input_ports:
        - joint_positions
        - pressures_<pad>
        - age_<pad>
        output_ports:
        - patches
        - pads
        - status

    - joint_positions: measured positions of the hand's joints, shape (nq,) of the hand's own plant, rad.
    - pressures_<pad>: one per pad, the pressures of its cells, Pa; NaN where a cell is dead; all NaN if there is no
      reading. A cell that reads more than the array's range counts as dead, as does one that the array's file
      lists as dead. May stay unconnected, which counts as no reading.
    - age_<pad>: one per pad, the age of its pressures, s, shape (1,). May stay unconnected if pressures are never old.
    - patches: tuple of `Patch` in P of the pads with a usable reading that is not too old, in the order of the hand's
      description; those that nothing touches have the status "no_contact". Changes with any input.
    - pads: tuple of the names of those pads, one for each patch.
    - status: str, "ok" if every pad feels the object; else each pad that does not, and why: "no contact", "no
      reading", "stale: " and its age, "unusable: " and which pressure is negative, or a joint position that is not
      finite; and each pad with cells beyond their range, with the cells' numbers.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        hand: Hand,
        params: PatchDescriptorParams | None = None,
        uncertainty: PadUncertainty | None = None,
    ) -> None:
        """Keeps a reference to the plant, and reads the arrays that the hand's description names.

        Args:
            plant: finalized plant of the hand alone, for kinematics; not the simulator's.
            hand: the hand in it.
            params: thresholds.
            uncertainty: the hand's errors, from which the uncertainty of each pad's pose is computed.

        Raises:
            InvalidInputError: if the hand has no pads, an array's file is unusable, a pad's threshold or noise is
                beyond its range, or a pad is read less often than `max_age`.
        """
        super().__init__()
        self._params = params_of(PatchDescriptorParams, params)
        if not hand.pad_frames:
            raise InvalidInputError("hand must have at least one tactile pad, not none.")
        self._pad_frames, self._uncertainty = hand.pad_frames, uncertainty
        self._pads = {pad.name: load_tactile_pad(pad.array) for pad in hand.config.pads}
        self._alpha = {pad.name: pad.alpha for pad in hand.config.pads}
        self._least = {name: self._least_pressure(name, pad) for name, pad in self._pads.items()}
        self._positions = self.DeclareVectorInputPort("joint_positions", plant.num_positions())
        self._pressures = {
            name: self.DeclareVectorInputPort(f"pressures_{name}", len(pad.layout)) for name, pad in self._pads.items()
        }
        self._ages = {name: self.DeclareVectorInputPort(f"age_{name}", 1) for name in self._pads}
        self._kinematics = declare_kinematics(self, plant, hand.palm_frame, self._positions)
        read = [port.ticket() for port in (*self._pressures.values(), *self._ages.values())]
        needs = {self._kinematics.ticket(), *read}
        self._described = self.declare_value("patches by pad", self._calc_described, needs)
        described = {self._described.ticket()}
        self.declare_output("patches", (), lambda context: tuple(self._patches(context).values()), described)
        self.declare_output("pads", (), lambda context: tuple(self._patches(context)), described)
        self.declare_output("status", "", self._status, described)

    def _least_pressure(self, name: str, pad: TactilePad) -> float:
        """The lowest pressure above which a pad's cells are active, Pa; checks threshold, noise and period."""
        most, noise, params = pad.model.range, pad.model.noise, self._params
        if most <= params.threshold:
            raise InvalidInputError(
                f"PatchDescriptorParams.threshold must be below the range of pad {name!r}, {most:g} Pa, not "
                f"{params.threshold:g} Pa."
            )
        if most <= _NOISES * noise:
            raise InvalidInputError(
                f"TactileModel.noise must be below a quarter of the range of pad {name!r}, {most:g} Pa, not {noise:g} "
                "Pa."
            )
        if pad.period > params.max_age:
            raise InvalidInputError(
                f"PatchDescriptorParams.max_age must be at least the period of pad {name!r}, {pad.period:g} s, not "
                f"{params.max_age:g} s."
            )
        return max(params.threshold, _NOISES * noise)

    def _calc_described(self, context: Context) -> dict[str, _Described]:
        """What each pad feels."""
        described: dict[str, _Described] = {}
        kinematics = self._kinematics.Eval(context)
        X_PT = kinematics.poses(self._pad_frames)
        for name, port in self._pressures.items():
            pressure = port.Eval(context) if port.HasValue(context) else np.full(port.size(), np.nan)
            age = float(self._ages[name].Eval(context)[0]) if self._ages[name].HasValue(context) else 0.0
            if name not in X_PT:
                described[name] = _Described(None, kinematics.fault(self._pad_frames[name]))
            elif not np.isfinite(age) or (abs(age) <= self._params.max_age and np.all(np.isnan(pressure))):
                described[name] = _Described(None, NO_READING)
            elif abs(age) > self._params.max_age:  # A frame from the future, by another clock, is stale, too.
                described[name] = _Described(None, stale(age, self._params.max_age))
            else:
                described[name] = self._describe(name, X_PT[name], pressure, kinematics)
        return described

    def _describe(
        self, name: str, X_PT: RigidTransform, pressure: FloatArray, kinematics: HandKinematics
    ) -> _Described:
        pad: TactilePad = self._pads[name]
        errors, most = self._uncertainty, pad.model.range
        pressure, beyond = pad.known_pressures(pressure)
        numbers = ", ".join(map(str, np.flatnonzero(beyond)))
        remark = f"cells beyond the range, {most:g} Pa: {numbers}" if numbers else ""
        if np.all(np.isnan(pressure)):
            return _Described(None, remark or NO_READING)
        try:
            patch = describe_patch(
                X_PT.multiply(pad.layout.p_TC.T).T,
                pressure,
                alpha=self._alpha[name],
                n_PT=pad.layout.n_T @ X_PT.rotation().matrix().T,
                threshold=max(self._least[name], self._params.threshold_share * float(np.nanmax(pressure))),
                saturation=most,
                misplacement=None if errors is None else errors.covariance(name, pad.layout, kinematics),
            )
        except InvalidInputError as error:
            return _Described(None, f"unusable: {str(error).removesuffix('.')}")
        return _Described(patch, ", ".join(filter(None, ("" if patch.is_felt else "no contact", remark))))

    def _patches(self, context: Context) -> dict[str, Patch]:
        """The known patches, by pad."""
        described: dict[str, _Described] = self._described.Eval(context)
        return {name: pad.patch for name, pad in described.items() if pad.patch is not None}

    def _status(self, context: Context) -> str:
        described: dict[str, _Described] = self._described.Eval(context)
        remarks = [f"{name}: {pad.remark}" for name, pad in described.items() if pad.remark]
        return "; ".join(remarks) or "ok"
