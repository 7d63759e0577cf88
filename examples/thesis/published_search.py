"""The global search of chapter 4 of the thesis with the thesis' cost, and without the cost of a prior.

`method="monte_carlo"` of `tp.estimate_pose` is the same search with our likelihood on the signed distance grid. Here it
minimises eq. 4.1: each contact's cost is its distance from a point of the object plus the weighted angle to the normal
there, at that of the nearest points, found by a k-d tree, at which this sum is least. Without a prior, the final poses
are checked for collisions with the hand.

The thesis does not state w_n for this chapter; of 5, 10, 20 and 40 (lengths in cm, as in chapter 3), 5 gave the best
results here. The design without a prior is tuned to this cost, too. The points are the centres of the mesh's triangles,
about ten thousand.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.2.
"""

import functools
from typing import NamedTuple

import numpy as np
from grasp_library import Array
from grasp_trials import Trial

import tactopose_drake as tp
from tactopose_drake.core.objectives import NearestPointContact
from tactopose_drake.core.searches import MonteCarlo, MonteCarloDesign, PoseSpace, PriorSpace, TouchSpace

NORMAL_WEIGHT = 0.05  # w_n, m
# Points that a contact is compared with: within about 3 mm, so that both sides of the glass' wall are included.
NEIGHBOURS = 20
# Fingertips are soft, and the final poses inexact: a sphere of the hand may penetrate the object to this depth, m.
OVERLAP = 0.005


@functools.cache
def point_cloud(model: tp.ObjectModel) -> tuple[Array, Array]:
    """The triangles' centres (n, 3), m, and normals (n, 3)."""
    a, b, c = np.swapaxes(model.vertices[model.faces], 0, 1)
    cross = np.cross(b - a, c - a)
    return (a + b + c) / 3.0, cross / np.linalg.norm(cross, axis=1, keepdims=True)


class PublishedProblem(NamedTuple):
    """The thesis' search, its objective, and its space of poses."""

    search: MonteCarlo
    objective: NearestPointContact
    space: PoseSpace


def published_problem(model: tp.ObjectModel, trial: Trial) -> PublishedProblem:
    """The thesis' method for a trial."""

    def is_possible(X_PO: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        gap = model.grid.distance((trial.hand.p_PH - X_PO[:, None, :, 3]) @ X_PO[:, :, :3]) - trial.hand.radius
        possible: np.ndarray[tuple[int], np.dtype[np.bool_]] = gap.min(axis=1) > -OVERLAP
        return possible

    contacts, prior = trial.contacts, trial.prior
    search = MonteCarlo(
        # Costs that are not squared distinguish poses less sharply: a lower power and fewer particles are sufficient.
        anywhere=MonteCarloDesign(
            particles=100_000, population=5000, power=100.0, noise=0.3, cooling=2.0, confidence=50.0
        ),
        scale=len(contacts) * (0.01 + NORMAL_WEIGHT) / 100.0,  # [B16] eq. 4.13, which is in cm
        is_possible=is_possible if prior is None else None,
    )
    objective = NearestPointContact(*point_cloud(model), contacts, NORMAL_WEIGHT, NEIGHBOURS)
    return PublishedProblem(search, objective, TouchSpace(model, contacts) if prior is None else PriorSpace(prior))


def search_as_published(model: tp.ObjectModel, trial: Trial, seed: int = 0) -> Array:
    """The final poses (B, 3, 4) of the search, best first."""
    search, objective, space = published_problem(model, trial)
    return search.minimize(objective, space, np.random.default_rng(seed)).X_PO
