"""The joints between a frame and each body of a hand, which must be known for their relative pose."""

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame

from tactopose_drake.core.validation import FloatArray


class JointPaths:
    """Tells which bodies' poses are known when some joint positions are not (NaN)."""

    def __init__(self, plant: MultibodyPlant, frame: Frame) -> None:
        """Finds the joints between a frame and every body.

        Args:
            plant: finalized plant of the hand alone.
            frame: the frame in which poses are expressed.
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
        """Indices of the positions on which a body's pose in the frame depends, shape (k,)."""
        return np.flatnonzero(self._needed[body])

    def known(self, q: FloatArray) -> NDArray[np.bool_]:
        """Whether each body's pose in the frame is known, shape (number of bodies,).

        Args:
            q: positions, shape (nq,), rad; NaN where unknown.
        """
        unknown = ~np.isfinite(q)
        return np.asarray(~self._needed[:, unknown].any(axis=1)) if unknown.any() else self._all
