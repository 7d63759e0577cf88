"""Which joints lie between two frames of a hand: what must be known to know where one is in the other."""

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame

from tactopose_drake.core.validation import FloatArray


class JointPaths:
    """Tells whether a body's pose is known where some joint positions are not (NaN)."""

    def __init__(self, plant: MultibodyPlant, frame: Frame) -> None:
        """Finds the joints between a frame and every body.

        Args:
            plant: finalized plant of the hand alone.
            frame: that poses are in.
        """
        path: dict[int, set[int]] = {int(plant.world_body().index()): set()}
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        while joints:
            joint = next(joint for joint in joints if int(joint.parent_body().index()) in path)
            joints.remove(joint)
            own = range(joint.position_start(), joint.position_start() + joint.num_positions())
            path[int(joint.child_body().index())] = path[int(joint.parent_body().index())] | set(own)
        to_frame = path[int(frame.body().index())]
        self._needed = np.zeros((plant.num_bodies(), plant.num_positions()), dtype=np.bool_)
        for body, positions in path.items():
            self._needed[body, sorted(positions ^ to_frame)] = True
        self._all = np.ones(plant.num_bodies(), dtype=np.bool_)
        self._all.setflags(write=False)

    def between(self, body: int) -> NDArray[np.intp]:
        """The places of the positions that must be known to know a body's pose in the frame, shape (k,)."""
        return np.flatnonzero(self._needed[body])

    def known(self, q: FloatArray) -> NDArray[np.bool_]:
        """Whether each body's pose in the frame is known, shape (number of bodies,).

        Args:
            q: positions, shape (nq,), rad; NaN where not known.
        """
        unknown = ~np.isfinite(q)
        return np.asarray(~self._needed[:, unknown].any(axis=1)) if unknown.any() else self._all
