"""The touch of a frame, as a belief knows its sources."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.pose_belief import PoseBelief


class FrameTouch(NamedTuple):
    """The contacts of a frame by the sources that the belief knows.

    Attributes:
        contacts: all points that are touched.
        source: the source of each, shape (k,).
        sources: names of all sources.
        is_new: whether this reading is not the last one again.
    """

    contacts: Contacts
    source: NDArray[np.intp]
    sources: tuple[str, ...]
    is_new: bool

    @property
    def is_felt(self) -> bool:
        return len(self.contacts) > 0


def gather_touch(belief: PoseBelief, frame: Frame) -> FrameTouch:
    """The frame's touch by the sources known so far and the new ones."""
    contacts = frame.evidence.touch
    assert frame.sources is not None
    sources = belief.sources + tuple(name for name in frame.sources if name not in belief.sources)
    source = np.array([sources.index(name) for name in frame.sources], dtype=np.intp)
    is_new = len(contacts) > 0 and not np.array_equal(contacts.p_PC, belief.touched)
    return FrameTouch(contacts, source, sources, is_new)
