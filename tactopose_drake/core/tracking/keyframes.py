"""The fixed-lag window: the last few touches that told something new, related by the motion since.

A pose is judged by all of them together, as one touch may determine what another leaves open. The motion between them
is measured with an error, which adds to that of each contact. So a touch counts less as the object moves on, and one
from the time when the fingers were still closing hardly counts.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contact_reading import ContactReading
from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.motion.rigid_motion import Motion
from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.plain_values import copied
from tactopose_drake.core.poses import point_jacobians
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.contact_errors import averaged_variances, calibration_excess
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.tracker_params import PoseTrackerParams, WindowParams
from tactopose_drake.core.validation import FloatArray


@dataclasses.dataclass(frozen=True, eq=False)
class Keyframe:
    """A touch of the past, of k contacts.

    Attributes:
        p_PC: the contacts in P at that time, shape (k, 3), m.
        n_PC: their normals, shape (k, 3), or None.
        variances: of their points, m^2, and of their normals, rad^2, shape (k, 2).
        sources: of the contacts.
        X_PP: the motion of the object in P since then, to be multiplied from the left, shape (3, 4).
        covariance: of this motion's error, a small twist [rotation vector, translation] about the origin of P applied
            after it, shape (6, 6).
        frames: how many frames the contacts are the mean of.
    """

    p_PC: FloatArray
    n_PC: FloatArray | None
    variances: FloatArray
    sources: tuple[str, ...]
    X_PP: FloatArray
    covariance: FloatArray
    frames: int = 1

    @classmethod
    def of_now(cls, reading: ContactReading, sources: tuple[str, ...]) -> "Keyframe":
        """The keyframe of the current touch."""
        contacts = reading.contacts
        return cls(
            contacts.p_PC,
            contacts.n_PC,
            reading.evidence.touch.variances,
            sources,
            np.eye(3, 4),
            np.zeros((6, 6)),
        )

    @functools.cached_property
    def points(self) -> FloatArray:
        """Where the contacts' points are now, shape (k, 3), m."""
        points: FloatArray = self.p_PC @ self.X_PP[:, :3].T + self.X_PP[:, 3]
        return points

    @functools.cached_property
    def normals(self) -> FloatArray | None:
        """The contacts' normals now, shape (k, 3)."""
        return None if self.n_PC is None else self.n_PC @ self.X_PP[:, :3].T

    @property
    def added_variances(self) -> FloatArray:
        """Variances from the motion's error: of each point's distance, m^2, and of each normal, rad^2, shape (k, 2).

        That of a normal is the mean of the rotations about the two axes across it, as a turn about itself changes
        nothing.
        """
        points, normals = self.points, self.normals
        arms, turn = point_jacobians(points), self.covariance[:3, :3]
        error = arms @ self.covariance @ np.swapaxes(arms, 1, 2)
        if normals is None:
            across, turned = np.trace(error, axis1=1, axis2=2) / 3.0, np.full(len(points), np.trace(turn) / 3.0)
        else:
            across = np.einsum("ki,kij,kj->k", normals, error, normals)
            turned = 0.5 * (np.trace(turn) - np.einsum("ki,ij,kj->k", normals, turn, normals))
        return np.stack([across, turned], axis=1)

    def joined_by(self, now: "Keyframe", max_frames: int) -> "Keyframe":
        """Averages the current touch with this one, by the same fingers at the same places."""
        frames, (points, normals), n_PC = min(self.frames + 1, max_frames), self._in_order_of(now), now.n_PC
        if n_PC is not None and normals is not None:
            n_PC = normals + (n_PC - normals) / frames
            n_PC = n_PC / np.sqrt(np.einsum("ki,ki->k", n_PC, n_PC))[:, None]
        p_PC = points + (now.p_PC - points) / frames
        return copied(now, p_PC=p_PC, n_PC=n_PC, frames=frames)

    def tells_other_than(self, now: "Keyframe", params: WindowParams) -> bool:
        """Whether other fingers touch now, or one of them touches elsewhere on the object."""
        if self.sources != now.sources and set(self.sources) != set(now.sources):
            return True
        points, normals = self._in_order_of(now)
        moved = points - now.p_PC
        if np.einsum("ki,ki->k", moved, moved).max(initial=0.0) > params.least_distance**2:
            return True
        if normals is None or now.n_PC is None:
            return False
        cosine = np.einsum("ki,ki->k", normals, now.n_PC).min(initial=1.0)
        return bool(cosine < math.cos(math.radians(params.least_turn_deg)))

    def _in_order_of(self, now: "Keyframe") -> tuple[FloatArray, FloatArray | None]:
        """The present points and normals in the order of a touch by the same sources."""
        if self.sources == now.sources:
            return self.points, self.normals
        order = [self.sources.index(source) for source in now.sources]
        return self.points[order], None if self.normals is None else self.normals[order]


@dataclasses.dataclass(frozen=True, eq=False)
class TouchWindow:
    """What the window tells about the current pose.

    Attributes:
        now: the current touch.
        past: contacts of earlier, different touches, moved to the present; None if there are none.
        keyframe: index of the touch that each of these belongs to, shape (k,).
        count: number of touches, including the current one.
    """

    now: Keyframe
    past: Contacts | None
    keyframe: NDArray[np.intp]
    count: int


def move_keyframes(keyframes: tuple[Keyframe, ...], motion: Motion) -> tuple[Keyframe, ...]:
    """Moves keyframes by a further motion of the object."""
    if not keyframes:
        return ()
    adjoint = motion.adjoint
    return tuple(
        copied(
            frame,
            X_PP=motion.of_poses(frame.X_PP),
            covariance=adjoint @ frame.covariance @ adjoint.T + motion.covariance,
        )
        for frame in keyframes
    )


def follow_touch(keyframes: tuple[Keyframe, ...], now: Keyframe, params: WindowParams) -> tuple[Keyframe, ...]:
    """Updates the keyframes, oldest first, with the current touch as the last, and drops uninformative ones.

    While the touch stays the same, the last keyframe is its running mean, which averages the noise of single frames.
    """
    if keyframes and not keyframes[-1].tells_other_than(now, params):
        return (*keyframes[:-1], keyframes[-1].joined_by(now, params.max_frames))
    kept = [frame for frame in keyframes if np.sqrt(frame.added_variances[:, 0].mean()) < params.max_sigma]
    return (*kept[-params.max_keyframes :], now)


def make_window(keyframes: tuple[Keyframe, ...], params: WindowParams) -> TouchWindow:
    """The current touch, which is the last keyframe, with those keyframes that differ from it."""
    now = keyframes[-1]
    added = [(frame, frame.added_variances) for frame in keyframes[:-1] if frame.tells_other_than(now, params)]
    added = [(frame, more) for frame, more in added if np.sqrt(more[:, 0].mean()) < params.max_sigma]
    if not added:
        return TouchWindow(now, None, np.zeros(0, dtype=np.intp), 1)
    normals = [frame.normals for frame, _ in added]
    past = Contacts(
        np.concatenate([frame.points for frame, _ in added]),
        None if any(n is None for n in normals) else np.concatenate([n for n in normals if n is not None]),
    ).with_variances(np.concatenate([frame.variances + more for frame, more in added]))
    keyframe = np.repeat(np.arange(len(added)), [len(frame.p_PC) for frame, _ in added])
    return TouchWindow(now, past, keyframe, 1 + len(added))


class Touch(NamedTuple):
    """The data by which poses are judged at one time.

    Attributes:
        evidence: at this time.
        reading: its contacts by source.
        keyframes: the past touches, and the current one as the last.
        standing: the fused pose from vision, moved to this time.
        depth_in_hand: see `Frame`.
    """

    evidence: Evidence
    reading: ContactReading
    keyframes: tuple[Keyframe, ...]
    standing: PoseMeasurement | None
    depth_in_hand: Callable[[FloatArray], FloatArray] | None = None

    def averaged(self, params: PoseTrackerParams) -> Evidence:
        """The evidence with the mean contacts of the current keyframe and their variances, and vision as the prior."""
        contacts, now = self.evidence.contacts, self.keyframes[-1]
        if len(contacts) == len(now.p_PC):
            more = calibration_excess(contacts, params, self.reading.errors.calibration)
            variances = averaged_variances(contacts, params, now.frames) + more
            contacts = contacts.with_arrays(p_PC=now.p_PC, n_PC=now.n_PC).with_variances(variances)
        prior = None if self.standing is None else self.standing.as_prior()
        return self.evidence.with_parts(contacts, prior)


def past_cost(model: ObjectModel, params: PoseTrackerParams, window: TouchWindow, X_PO: FloatArray) -> FloatArray:
    """The cost of poses (n, 3, 4) by the past touches, shape (n,).

    A touch may date from before an unnoticed slip, so the cost of each is capped by that of such an outlier. The hand's
    calibration error is common to all, so each counts by the effective sample size over their number.
    """
    if window.past is None:
        return np.zeros(len(X_PO))
    touch = SurfaceContact(model.grid, window.past)
    residuals = touch.rows_of_contacts(np.ascontiguousarray(X_PO))[0]
    costs = np.zeros((window.count - 1, len(X_PO)))
    np.add.at(costs, window.keyframe, 0.5 * np.square(residuals).sum(axis=2).T)
    numbers = np.bincount(window.keyframe) * (1 if window.past.n_PC is None else 3)
    limits = 0.5 * numbers - math.log(params.window.slip_probability)
    total: FloatArray = _share(params, window) * np.minimum(costs, limits[:, None]).sum(axis=0)
    return total


def past_objective(model: ObjectModel, params: PoseTrackerParams, window: TouchWindow) -> SurfaceContact:
    """The objective of the past touches, of which there must be one, weighted as in `past_cost` but without its cap."""
    assert window.past is not None
    return SurfaceContact(model.grid, window.past.with_variances(window.past.variances / _share(params, window)))


def past_information(
    model: ObjectModel, params: PoseTrackerParams, window: TouchWindow, X_PO: FloatArray
) -> FloatArray:
    """The information of the past touches on the increments at poses (n, 3, 4), shape (n, 6, 6).

    A past contact at a place that is touched now repeats the same measurement with the same errors, and does not count.
    """
    if window.past is None:
        return np.zeros((len(X_PO), 6, 6))
    distances = np.linalg.norm(window.past.p_PC[:, None] - window.now.p_PC, axis=2)
    elsewhere = np.flatnonzero(distances.min(axis=1) > params.window.least_distance)
    if not len(elsewhere):
        return np.zeros((len(X_PO), 6, 6))
    touch = SurfaceContact(model.grid, window.past[elsewhere])
    return _share(params, window) * touch.normal_equations(np.ascontiguousarray(X_PO)).hessian


def _share(params: PoseTrackerParams, window: TouchWindow) -> float:
    """The weight of each touch: the effective sample size over the number of touches."""
    return 1.0 / (1.0 + (window.count - 1) * params.window.lasting_share)
