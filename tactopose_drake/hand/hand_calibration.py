"""Calibration of a hand from grasps of known objects in unknown poses: the errors that explain all of them together.

Each contact says that a point of the hand is on the object's surface, and which way the surface faces there. Six of
these numbers of a grasp are spent on the object's pose; the others are about the hand, and the hand is the same in all
grasps. So the offsets of the encoders, the biases of the sensors, and the fingertips' radii and mountings are found
together with all poses, in one least-squares problem, whose prior is what the hand's file says of its `uncertainty`.
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
from tactopose_drake.core.validation import FloatArray, instance_of, positive_number, whole_number
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.calibration_file import HandCalibration, save_calibration
from tactopose_drake.hand.calibration_from_errors import calibration_of
from tactopose_drake.hand.felt_grasps import FeltGrasps
from tactopose_drake.hand.grasp_poses import PoseFit, PoseHunt, fit_poses
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_errors import HandErrors
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.recorded_grasps import RecordedGrasp, check_grasps, check_silence

_FEWEST = 3
USED = 0.5
"""Weight of a grasp from which on it counts as explained."""
_BEFORE = (0.003, math.radians(10.0))  # noise with which poses are fitted to the hand as its files have it, m, rad


@dataclasses.dataclass(kw_only=True, slots=True)
class CalibrationParams:
    """What a calibration begins with; the noise that the grasps show takes its place.

    Attributes:
        sigma_position: of a contact's distance from the surface by other than the hand's errors, m.
        sigma_normal_deg: likewise of its normal about each axis, deg.
        seed: of the searches for the poses.
    """

    sigma_position: float = 0.0003
    sigma_normal_deg: float = 1.5
    seed: int = 0

    def validate(self) -> None:
        """Checks every field.

        Raises:
            InvalidInputError: a value that is out of its range.
        """
        positive_number("CalibrationParams.sigma_position", self.sigma_position)
        positive_number("CalibrationParams.sigma_normal_deg", self.sigma_normal_deg)
        whole_number("CalibrationParams.seed", self.seed, least=0)


@dataclasses.dataclass(frozen=True, eq=False)
class FingerResiduals:
    """How far one finger's contacts are off the object's surface.

    Attributes:
        distance: shape (k,), m.
        angle: of the normal, shape (k,), rad.
    """

    distance: FloatArray
    angle: FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class CalibrationResult:
    """What a calibration found.

    Attributes:
        calibration: what `save` writes, and a hand's file names.
        names: of the errors that were looked for.
        values: of these, shape (d,), SI units.
        covariance: of these, shape (d, d), in their units.
        undetermined: combinations of errors of which the grasps say nothing.
        X_PO: the object's poses X_PO in the grasps, shape (g, 3, 4), translations in m.
        pose_probability: probability of each of these poses, shape (g,): where it is not near 1, another pose explains
            the grasp, too, and the covariance is the wider for it. NaN where no finger touches.
        grasp_weights: weight of each grasp, 1 where it fits the others, 0 where it counted for nothing, shape (g,). NaN
            where no finger touches.
        contact_weights: likewise of the contacts in the grasps that fit, by finger, shape (k,) each: a finger whose
            contacts count for nothing in grasp after grasp has its errors only by what the hand's file says of them.
        without_contact: fingers that touch but of whose wrenches none makes a contact, each with the solver's reason.
        before: residuals of the hand as its files have it, by finger, each grasp's pose being the best for it.
        after: residuals of the calibrated hand, by finger.
        converged: whether the fit had come to its end.
        sliding: the measured joints that slide; their offsets are in m, those of the others in rad.
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
    """Finds what a hand is off by from grasps of known objects, whose poses in the hand are not known.

    A hand's `uncertainty` says how large its errors may be, each 0 that is not to be looked for; without it, those of a
    good research hand are taken. A calibration that the hand's file names already is left aside.

    Args:
        hand: the hand's description, its name, or the path of its file.
        grasps: what was recorded, 10 to 40 as a rule: of an object without symmetry, by three fingers or more, held in
            as different ways as the hand can. Where all have a time, and it is not one, biases may drift.
        params: what the fit begins with.
        on_progress: is told how much of the work is done, from 0 to 1, and what begins.

    Raises:
        InvalidInputError: fewer than 3 grasps with a contact, or that can be explained together; a grasp with a name
            that the hand has not, or that lacks a joint's reading; a sensor out of touch that reads much more than
            the hand's `uncertainty` says of its bias.
        InvalidFileError: if the hand's file cannot be used.
    """
    params = params_of(CalibrationParams, params)
    if not isinstance(hand, HandConfig | str | Path):
        raise InvalidInputError(
            f"hand: is a {type(hand).__name__}; allowed are a HandConfig, a hand's name and the path of its file."
        )
    instance_of("grasps", grasps, Sequence)
    config = hand if isinstance(hand, HandConfig) else load_hand_config(hand, with_calibration=False)
    if len(grasps) < _FEWEST:
        raise InvalidInputError(f"grasps: there are {len(grasps)}; allowed are {_FEWEST} or more.")
    plant, parts = make_hand_plant(dataclasses.replace(config, calibration=""))
    check_grasps(plant, parts, grasps)
    uncertainty = HandUncertainty() if config.uncertainty is None else config.uncertainty
    errors = HandErrors.of(plant, parts, uncertainty, _time_span(grasps))
    if not len(errors.free):
        raise InvalidInputError("uncertainty: every error is 0; allowed is at least one above 0.")
    check_silence(errors, grasps)
    felt = FeltGrasps(plant, parts, errors, grasps)
    if not len(felt.grasp):
        raise InvalidInputError("grasps: no finger with a force-torque sensor touches in any; allowed are those where.")
    _check_contacts(felt, len(grasps), len(errors.free))
    rows, measured = felt.readings(grasps)
    models = [grasp.model for grasp in grasps]
    problem = SharedProblem(felt.touches, [model.grid for model in models], rows, measured)
    noise = ContactNoise(felt.wrench_noise(), params.sigma_position, math.radians(params.sigma_normal_deg))
    found = PoseHunt(problem, models, noise, params.seed).best_fit(on_progress or (lambda share, doing: None))
    _check_fit(found, len(grasps))
    return _result(felt, errors, problem, found)


def _check_contacts(felt: FeltGrasps, count: int, errors: int) -> None:
    """Raises InvalidInputError if there is hardly a contact to begin with."""
    none = np.zeros(errors)
    touches = felt.touches(none)
    touched = len(np.unique(touches.grasp[touches.valid]))
    if touched < _FEWEST:
        reasons = "".join(
            f" No wrench of {finger} makes one: {reason}." for finger, reason in felt.without_contact(none).items()
        )
        raise InvalidInputError(
            f"grasps: {touched} of {count} have a contact; the least is {_FEWEST}.{reasons} Allowed are wrenches on "
            "the fingertip about its sensor's origin, moments in N m before forces in N."
        )


def _check_fit(found: PoseFit, count: int) -> None:
    """Raises InvalidInputError if the fit explains hardly a grasp."""
    at = found.fit.solution.at
    explained = np.intersect1d(at.touches.grasp[at.touches.valid], np.flatnonzero(at.grasp_weights >= USED))
    if len(explained) < _FEWEST:
        raise InvalidInputError(
            f"grasps: {len(explained)} of {count} can be explained together, each by a pose of the object; the least "
            f"is {_FEWEST}. Mostly it is another object, a reading in other units or another order, or an error that "
            "is larger than the hand's `uncertainty` says."
        )


def _time_span(grasps: Sequence[RecordedGrasp]) -> float:
    """The time over which biases may have drifted, s; 0 where it is not known."""
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
    """In m and rad, NaN where there is no contact."""
    # A position without noise leaves the difference of the normals as it is.
    tiny, one = np.full(len(finger), 1e-9), np.ones(len(finger))
    residual = surface_rows(problem.grids, X_PO, touches, ContactSigmas(tiny, one)).residual * [1e-9, 1.0, 1.0, 1.0]
    residual = np.where(touches.valid[:, None], residual, np.nan)
    angle = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(residual[:, 1:], axis=1), 0.0, 1.0))
    return {
        name: FingerResiduals(residual[finger == k, 0], angle[finger == k]) for k, name in enumerate(errors.fingers)
    }
