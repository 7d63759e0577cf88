"""The global search of chapter 4 of the thesis with the cost that the thesis gives it, and without a prior's cost.

`method="monte_carlo"` of `tp.estimate_pose` is the same search, of our likelihood on the signed distance grid. Here it
minimises eq. 4.1: each contact counts by the distance to a point of the object and the angle to the normal there, at
the point where their sum is least among the nearest ones, which a k-d tree finds. Without a guess the poses that it
ends with are checked for collisions with the hand.

The thesis does not print w_n for this chapter; of 5, 10, 20 and 40 (lengths in cm, as in chapter 3) 5 did best here.
The design without a guess is tuned to this cost too. The points are the centres of the mesh's triangles, some ten
thousand.

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
# Points that a contact is compared with: within about 3 mm, so that both sides of the glass' wall are among them.
NEIGHBOURS = 20
# The fingertips are soft, and the poses blurred: a sphere of the hand may reach so deep into the object, m.
OVERLAP = 0.005


@functools.cache
def point_cloud(model: tp.ObjectModel) -> tuple[Array, Array]:
    """The triangles' centres (n, 3), m, and normals (n, 3)."""
    a, b, c = np.swapaxes(model.vertices[model.faces], 0, 1)
    cross = np.cross(b - a, c - a)
    return (a + b + c) / 3.0, cross / np.linalg.norm(cross, axis=1, keepdims=True)


class PublishedProblem(NamedTuple):
    """The thesis' search, what it minimises, and where."""

    search: MonteCarlo
    objective: NearestPointContact
    space: PoseSpace


def published_problem(model: tp.ObjectModel, trial: Trial) -> PublishedProblem:
    """What the thesis would do with a trial."""

    def is_possible(X_PO: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        gap = model.grid.distance((trial.hand.p_PH - X_PO[:, None, :, 3]) @ X_PO[:, :, :3]) - trial.hand.radius
        possible: np.ndarray[tuple[int], np.dtype[np.bool_]] = gap.min(axis=1) > -OVERLAP
        return possible

    contacts, prior = trial.contacts, trial.prior
    search = MonteCarlo(
        # Costs that are not squared tell good poses from bad ones less sharply: a lower power, and fewer particles do.
        anywhere=MonteCarloDesign(
            particles=100_000, population=5000, power=100.0, noise=0.3, cooling=2.0, confidence=50.0
        ),
        scale=len(contacts) * (0.01 + NORMAL_WEIGHT) / 100.0,  # [B16] eq. 4.13, which counts in cm
        is_possible=is_possible if prior is None else None,
    )
    objective = NearestPointContact(*point_cloud(model), contacts, NORMAL_WEIGHT, NEIGHBOURS)
    return PublishedProblem(search, objective, TouchSpace(model, contacts) if prior is None else PriorSpace(prior))


def search_as_published(model: tp.ObjectModel, trial: Trial, seed: int = 0) -> Array:
    """The poses (B, 3, 4) that the search ends with, best first."""
    search, objective, space = published_problem(model, trial)
    return search.minimize(objective, space, np.random.default_rng(seed)).X_PO
