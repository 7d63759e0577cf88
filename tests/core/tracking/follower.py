"""A belief that is fed frame after frame of a box that is touched."""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.gaussian_prior import GaussianPrior
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.tracking.frame import Frame, PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tests.core.tracking.boxes import touch

NAMES = tuple("abcdef")
X_PO = make_poses(random_rotations(np.random.default_rng(0), 1), np.array([[0.02, 0.0, 0.1]]))[0]
GUESS = GaussianPrior(retract(X_PO, np.array([0.1, -0.15, 0.1, 0.01, -0.02, 0.01])))


class Follower:
    """A belief that is fed frame after frame, 10 ms apart."""

    def __init__(self, tracker: PoseTracker, seed: int = 0, period: float = 0.01) -> None:
        self.tracker, self.generator, self.period = tracker, np.random.default_rng(seed), period
        self.belief: PoseBelief = tracker.start(0.0)

    def feel(
        self,
        X: np.ndarray | None,
        count: int = 1,
        vision: PoseMeasurement | None = None,
        fingers: Sequence[int] = range(6),
        bias: np.ndarray | None = None,
    ) -> PoseBelief:
        """Frames of a touch at a pose by some fingers, off by a bias (6, 6) of all; of none, where the pose is None."""
        for _ in range(count):
            contacts = Contacts.empty() if X is None else touch(X, self.generator, bias)[list(fingers)]
            names = None if X is None else tuple(NAMES[i] for i in fingers)
            frame = Frame(self.belief.time + self.period, Evidence(contacts, prior=GUESS), names, vision=vision)
            self.belief = self.tracker.step(self.belief, frame)
        return self.belief
