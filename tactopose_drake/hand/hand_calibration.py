"""Calibration of a hand from grasps of known objects in unknown poses.

Each contact measures that a point of the hand is on the object's surface, and the surface's normal there. Six of a
grasp's measurements determine the object's pose; the others determine the hand's errors, which are the same in all
grasps. So the encoders' offsets, the sensors' biases, and the fingertips' radii and mountings are estimated together
with all poses in one least-squares problem, whose prior is the `uncertainty` in the hand's file.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.calibration.annealed_fit import ContactNoise
from tactopose_drake.core.calibration.combinations import Combination, undetermined
from tactopose_drake.core.calibration.shared_least_squares import SharedProblem
from tactopose_drake.core.calibration.surface_residuals import ContactSigmas, GraspContacts, surface_rows
from tactopose_drake.core.parameter_checks import params_of
from tactopose_drake.core.sensing.contact_noise import NANO17_SIGMA_FORCE, NANO17_SIGMA_MOMENT
from tactopose_drake.core.validation import FloatArray, kind_name, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.calibration_file import HandCalibration, save_calibration
from tactopose_drake.hand.calibration_poses import PoseFit, PoseHunt, fit_poses
from tactopose_drake.hand.felt_grasps import FeltGrasps
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_errors import HandErrors, calibration_of
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.recorded_grasps import RecordedGrasp, check_grasps, check_silence

_FEWEST = 3
USED = 0.5
"""Weight of a grasp from which on it counts as explained."""
_BEFORE = (0.003, math.radians(10.0))  # noise for fitting the poses of the uncalibrated hand, m, rad


@dataclasses.dataclass(kw_only=True, slots=True)
class CalibrationParams:
    """The initial noise of a calibration, which is then estimated from the grasps.

    Attributes:
        sigma_position: standard deviation of a contact's distance from the surface, beside the hand's errors, m.
        sigma_normal_deg: likewise of its normal about each axis, deg.
        seed: seed of the searches for the poses.
    """

    sigma_position: float = 0.0003
    sigma_normal_deg: float = 1.5
    seed: int = 0

    def validate(self) -> None:
        """Checks every field.

        Raises:
            InvalidInputError: if a value is out of its range.
        """
        positive_number("CalibrationParams.sigma_position", self.sigma_position)
        positive_number("CalibrationParams.sigma_normal_deg", self.sigma_normal_deg)
        whole_number("CalibrationParams.seed", self.seed, least=0)


@dataclasses.dataclass(frozen=True, eq=False)
class FingerResiduals:
    """Residuals of one finger's contacts to the object's surface.

    Attributes:
        distance: distance of each point, shape (k,), m.
        angle: angle between the normals, shape (k,), rad.
    """

    distance: FloatArray
    angle: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class CalibrationResult:
    """The result of a calibration.

    Attributes:
        calibration: the calibration, which `save` writes to a file for the hand's file to name.
        names: names of the errors that were estimated.
        values: their values, shape (d,), SI units. If biases drift, these are those in the middle of the recording, and
            those of `calibration` those at its end.
        covariance: their covariance, shape (d, d), in their units.
        undetermined: combinations of errors that the grasps do not determine.
        X_PO: the object's poses in the grasps, shape (g, 3, 4), translations in m.
        pose_probability: probability of each of these poses, shape (g,); if it is not near 1, another pose explains
            the grasp, too, and increases the covariance. NaN if no finger touches.
        grasp_weights: weight of each grasp, 1 if it agrees with the others, 0 if it was ignored, shape (g,). NaN if no
            finger touches.
        contact_weights: likewise of the contacts in grasps that agree, by finger, shape (k,) each. A finger whose
            contacts are ignored in most grasps has only the prior's errors.
        without_contact: fingers that touch but none of whose wrenches gives a contact, with the solver's reason.
        before: residuals of the uncalibrated hand, by finger, at the best pose of each grasp for it.
        after: residuals of the calibrated hand, by finger.
        converged: whether the fit has converged.
        sliding: the measured prismatic joints; their offsets are in m, those of the others in rad.
    """

    calibration: HandCalibration
    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    undetermined: tuple[Combination, ...]
    X_PO: FloatArray
    pose_probability: FloatArray
    grasp_weights: FloatArray
    contact_weights: dict[str, FloatArray]
    without_contact: dict[str, str]
    before: dict[str, FingerResiduals]
    after: dict[str, FingerResiduals]
    converged: bool
    sliding: tuple[str, ...]

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the values, shape (d,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def save(self, path: str | Path) -> None:
        """Writes calibration.yaml.

        Raises:
            InvalidFileError: if the file cannot be written.
        """
        save_calibration(Path(path), self.calibration)


def calibrate_hand(
    hand: HandConfig | str | Path,
    grasps: Sequence[RecordedGrasp],
    params: CalibrationParams | None = None,
    *,
    on_progress: Callable[[float, str], None] | None = None,
) -> CalibrationResult:
    """Estimates a hand's errors from grasps of known objects at unknown poses in the hand.

    The hand's `uncertainty` gives the prior standard deviations of the errors; an error with 0 is not estimated.
    Without it, those of a good research hand are used. A calibration that the hand's file already names is ignored.

    Args:
        hand: the hand's description, its name, or the path of its file.
        grasps: the recorded grasps, usually 10 to 40: of an object without symmetry, by three fingers or more, held in
            ways as different as possible. If all have times, and these differ, biases may drift.
        params: initial noise, and seed.
        on_progress: called with the share of the work that is done, from 0 to 1, and the name of the next step.

    Raises:
        InvalidInputError: if the hand has no force-torque sensor; if fewer than 3 grasps have a contact or can be
            explained together; if a grasp has a name that the hand lacks, or lacks a joint's reading; if a sensor out
            of touch reads much more than the hand's `uncertainty` says of its bias.
        InvalidFileError: if the hand's file cannot be used.
    """
    params = params_of(CalibrationParams, params)
    if not isinstance(hand, HandConfig | str | Path):
        raise InvalidInputError(
            f"hand must be a HandConfig, a hand's name or the path of its file, not {kind_name(type(hand))}."
        )
    if not isinstance(grasps, Sequence) or isinstance(grasps, str):
        raise InvalidInputError(
            "grasps must be a sequence of RecordedGrasp, which `load_grasps` of tactopose_drake.hand reads from a "
            f"folder, not {kind_name(type(grasps))}."
        )
    config = hand if isinstance(hand, HandConfig) else load_hand_config(hand, with_calibration=False)
    if len(grasps) < _FEWEST:
        raise InvalidInputError(f"grasps must be at least {_FEWEST}, not {len(grasps)}.")
    plant, parts = make_hand_plant(dataclasses.replace(config, calibration=""))
    if not parts.sensor_frames:
        raise InvalidInputError(
            "hand must have fingers with a force-torque sensor, but has none. Tactile pads alone cannot calibrate it."
        )
    check_grasps(plant, parts, grasps)
    uncertainty = HandUncertainty() if config.uncertainty is None else config.uncertainty
    errors = HandErrors.of(plant, parts, uncertainty, _time_span(grasps))
    if not len(errors.free):
        raise InvalidInputError("uncertainty must have at least one error above 0, but every one is 0.")
    check_silence(errors, grasps)
    felt = FeltGrasps(plant, parts, errors, grasps)
    if not len(felt.grasp):
        raise InvalidInputError("grasps must have fingers with a force-torque sensor that touch, but none does in any.")
    _check_contacts(felt, len(grasps), len(errors.free))
    rows, measured = felt.readings(grasps)
    models = [grasp.model for grasp in grasps]
    problem = SharedProblem(felt.touches, [model.grid for model in models], rows, measured)
    noise = ContactNoise(felt.wrench_noise(), params.sigma_position, math.radians(params.sigma_normal_deg))
    found = PoseHunt(problem, models, noise, params.seed).best_fit(on_progress or (lambda share, doing: None))
    _check_fit(found, len(grasps))
    return _result(felt, errors, problem, found)


def _check_contacts(felt: FeltGrasps, count: int, errors: int) -> None:
    """Raises InvalidInputError if too few grasps have a contact."""
    none = np.zeros(errors)
    touches = felt.touches(none)
    touched = len(np.unique(touches.grasp[touches.valid]))
    if touched < _FEWEST:
        reasons = "".join(
            f" No wrench of {finger} gives one: {reason}." for finger, reason in felt.without_contact(none).items()
        )
        raise InvalidInputError(
            f"grasps must have a contact in at least {_FEWEST}, not in {touched} of {count}.{reasons} Wrenches must be "
            "those on the fingertip about its sensor's origin, moments in N m before forces in N."
        )


def _check_fit(found: PoseFit, count: int) -> None:
    """Raises InvalidInputError if the fit explains too few grasps."""
    at = found.fit.solution.at
    explained = np.intersect1d(at.touches.grasp[at.touches.valid], np.flatnonzero(at.grasp_weights >= USED))
    if len(explained) < _FEWEST:
        raise InvalidInputError(
            f"grasps must be explained together in at least {_FEWEST}, each by a pose of the object, not in "
            f"{len(explained)} of {count}. The usual causes are another object, readings in other units or another "
            "order, and errors larger than the hand's `uncertainty` says."
        )


def _time_span(grasps: Sequence[RecordedGrasp]) -> float:
    """The time over which biases may have drifted, s; 0 if unknown."""
    times = [grasp.time for grasp in grasps if grasp.time is not None]
    return max(times) - min(times) if len(times) == len(grasps) else 0.0


def _result(felt: FeltGrasps, errors: HandErrors, problem: SharedProblem, found: PoseFit) -> CalibrationResult:
    fit, known, names = found.fit, found.known, tuple(errors.names[i] for i in errors.free)
    solution, sigma = fit.solution, errors.sigma[errors.free]
    combinations = undetermined(known.covariance, names)
    covariance = np.zeros((len(errors.sigma), len(errors.sigma)))
    covariance[np.ix_(errors.free, errors.free)] = known.covariance * np.outer(sigma, sigma)
    vector = felt.vector(known.mean)
    at_end = float(felt.times.max())
    calibration = calibration_of(errors, vector, covariance, at_end)
    has_touch = np.bincount(felt.grasp, minlength=len(problem.grids)) > 0
    grasp_weights = np.where(has_touch, solution.at.grasp_weights, np.nan)
    fits = grasp_weights[felt.grasp] >= USED
    calibration.grasps = int(np.sum(grasp_weights >= USED))
    calibration.undetermined = [combination.text for combination in combinations]
    calibration.noise.position = fit.noise.position
    calibration.noise.normal_deg = math.degrees(fit.noise.normal)
    calibration.noise.moment, calibration.noise.force = NANO17_SIGMA_MOMENT, NANO17_SIGMA_FORCE
    untold = problem.touch(np.zeros(len(solution.shared)))
    wide = ContactSigmas(*(np.full(len(felt.grasp), sigma) for sigma in _BEFORE))
    X_before, _ = fit_poses(problem, untold, solution.X_PO, wide)
    before = _residuals(problem, X_before, untold, errors, felt.finger)
    after = _residuals(problem, solution.X_PO, solution.at.touches, errors, felt.finger)
    return CalibrationResult(
        calibration,
        names,
        vector[errors.free],
        covariance[np.ix_(errors.free, errors.free)],
        combinations,
        solution.X_PO,
        np.where(has_touch, found.probability, np.nan),
        grasp_weights,
        {name: solution.at.weights[(felt.finger == k) & fits] for k, name in enumerate(errors.fingers)},
        felt.without_contact(solution.shared),
        before,
        after,
        solution.converged,
        tuple(joint for joint, slides in zip(errors.joints, errors.slides, strict=True) if slides),
    )


def _residuals(
    problem: SharedProblem, X_PO: FloatArray, touches: GraspContacts, errors: HandErrors, finger: NDArray[np.int64]
) -> dict[str, FingerResiduals]:
    """Residuals by finger, m and rad, NaN where there is no contact."""
    # A tiny position noise keeps the residual of the normals independent of the curvature at the point.
    tiny, one = np.full(len(finger), 1e-9), np.ones(len(finger))
    residual = surface_rows(problem.grids, X_PO, touches, ContactSigmas(tiny, one)).residual * [1e-9, 1.0, 1.0, 1.0]
    residual = np.where(touches.valid[:, None], residual, np.nan)
    angle = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(residual[:, 1:], axis=1), 0.0, 1.0))
    return {
        name: FingerResiduals(residual[finger == k, 0], angle[finger == k]) for k, name in enumerate(errors.fingers)
    }
