"""A can in the hand as pages show it, and the browser that reads them."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.visualization.body_meshes import sphere_triangles
from tactopose_drake.visualization.scene import Scene, ShownHypothesis
from tests.browser import Browser

COVARIANCE = np.diag(np.square([0.02, 0.02, 0.02, 0.002, 0.002, 0.002]))
SPIN = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
TOUCH = Contacts(
    [[0.03, 0, 0.01], [-0.03, 0, -0.02], [0, -0.03, 0.03]],
    [[1, 0, 0], [-1, 0, 0], [0, -1, 0]],
    [[2, 0, 0], [-1, 0, 0.2], [0, -3, 0.0]],
)
POSES = [RigidTransform(), RigidTransform([0.05, 0.0, 0.02]), RigidTransform([-0.05, 0.0, -0.02])]
SHARES = (0.6, 0.3, 0.1)


@pytest.fixture(scope="session")
def model() -> ObjectModel:
    cylinder = trimesh.creation.cylinder(radius=0.03, height=0.1, sections=48)
    return dataclasses.replace(ObjectModel.from_mesh(cylinder, cache=False), name="a_<b>can</b>")


@pytest.fixture(scope="session")
def estimate() -> PoseEstimate:
    hypotheses = (PoseHypothesis(X_PO, 1.0, share, COVARIANCE, SPIN) for X_PO, share in zip(POSES, SHARES, strict=True))
    return PoseEstimate(tuple(hypotheses), "ambiguous", 0.01)


@pytest.fixture(scope="session")
def scene(model: ObjectModel, estimate: PoseEstimate) -> Scene:
    hypotheses = [
        dataclasses.replace(ShownHypothesis.of(hypothesis), inlier_probability=np.array([0.9, 0.2, 0.95]))
        for hypothesis in estimate.hypotheses
    ]
    return Scene(
        model=model,
        contacts=TOUCH,
        hypotheses=tuple(hypotheses),
        prior=RigidTransform(RollPitchYaw(0.3, 0.0, 0.0), [0.0, -0.03, 0.03]),
        truth=RigidTransform([0.0, 0.0, 0.002]),
        hand=sphere_triangles(np.array([[0.0, 0.06, 0.0], [0.03, 0.06, 0.0]]), np.array([0.02, 0.02])),
    )


@pytest.fixture(scope="package")  # A page that is left open draws on and on, beside all tests that follow.
def browser() -> Iterator[Browser]:
    with Browser() as running:
        yield running
