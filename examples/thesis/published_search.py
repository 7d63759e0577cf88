"""The global search of chapter 4 of the thesis with the cost that the thesis gives it, and without a prior's cost.

`method="monte_carlo"` of `tp.estimate_pose` is the same search, of our likelihood on the signed distance grid. Here it
minimises eq. 4.1: each contact counts by the distance to a point of the object and the angle to the normal there, at
the point where their sum is least among the nearest ones, which a k-d tree finds. Without a guess the poses that it
ends with are checked for collisions with the hand.

The thesis does not print w_n for this chapter; of 5, 10, 20 and 40 (lengths in cm, as in chapter 3) 5 did best here.
The points are the centres of the mesh's triangles, some ten thousand.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.2.
"""

import functools

import numpy as np
from grasp_library import Array
from grasp_trials import Trial
from scipy.spatial import cKDTree

import tactopose_drake as tp
from tactopose_drake.core.objectives.differenced import DifferencedObjective
from tactopose_drake.core.searches.base import PriorSpace
from tactopose_drake.core.searches.monte_carlo import MonteCarlo
from tactopose_drake.core.searches.touch_space import TouchSpace

NORMAL_WEIGHT = 5.0  # w_n, cm
# Points that a contact is compared with: within about 3 mm, so that both sides of the glass' wall are among them.
NEIGHBOURS = 20
# The fingertips are soft, and the poses blurred: a sphere of the hand may reach so deep into the object, m.
OVERLAP = 0.005


class NearestPointContact(DifferencedObjective):
    """G, cm, as half a sum of squares: one residual sqrt(2 G_m) for each contact m. [B16] eq. 4.1."""

    def __init__(self, model: tp.ObjectModel, contacts: tp.Contacts) -> None:
        """The touch has normals."""
        self._tree, self._normals = point_cloud(model)
        self._contacts = contacts

    def residuals(self, X_PO: Array) -> Array:
        """Residuals (B, k) of poses (B, 3, 4)."""
        R_PO = X_PO[:, :, :3]
        distance, near = self._tree.query((self._contacts.p_PC - X_PO[:, None, :, 3]) @ R_PO, k=NEIGHBOURS)
        assert self._contacts.n_PC is not None
        cosine = np.einsum("bki,bkni->bkn", self._contacts.n_PC @ R_PO, self._normals[near])
        G = (100.0 * distance + NORMAL_WEIGHT * (1.0 - cosine)).min(axis=-1)
        residuals: Array = np.sqrt(2.0 * G.clip(0.0))
        return residuals


@functools.cache
def point_cloud(model: tp.ObjectModel) -> tuple[cKDTree, Array]:
    """The k-d tree of the triangles' centres, m, and the triangles' normals."""
    a, b, c = np.swapaxes(model.vertices[model.faces], 0, 1)
    cross = np.cross(b - a, c - a)
    return cKDTree((a + b + c) / 3.0), cross / np.linalg.norm(cross, axis=1, keepdims=True)


def search_as_published(model: tp.ObjectModel, trial: Trial, seed: int = 0) -> Array:
    """The poses (B, 3, 4) that the search ends with, best first."""

    def is_possible(X_PO: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        gap = model.grid.distance((trial.hand.p_PH - X_PO[:, None, :, 3]) @ X_PO[:, :, :3]) - trial.hand.radius
        possible: np.ndarray[tuple[int], np.dtype[np.bool_]] = gap.min(axis=1) > -OVERLAP
        return possible

    contacts, prior = trial.contacts, trial.prior
    search = MonteCarlo(
        scale=len(contacts) * (1.0 + NORMAL_WEIGHT) / 100.0,  # [B16] eq. 4.13
        is_possible=is_possible if prior is None else None,
    )
    space = TouchSpace(model, contacts) if prior is None else PriorSpace(prior)
    return search.minimize(NearestPointContact(model, contacts), space, np.random.default_rng(seed)).X_PO
