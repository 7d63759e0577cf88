"""Simulated objects of meshes that somebody has scanned."""

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.station.object_sdf import write_simulated_object

OFFSET = np.array([1.2, -1.0, 0.7])


@pytest.mark.parametrize("is_far", [False, True])
def test_the_frame_of_a_far_origin_is_moved_to_the_middle(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, is_far: bool
) -> None:
    mesh = trimesh.creation.box((0.04, 0.06, 0.08))
    offset = OFFSET if is_far else np.array([0.0, 0.0, 0.04])
    mesh.apply_translation(offset)
    model = ObjectModel.from_mesh(mesh, mass=0.3, name="scan", cache=False)
    with caplog.at_level(logging.WARNING, "tactopose_drake"):
        written = load_object(write_simulated_object(model, tmp_path))
    assert written.mass == pytest.approx(0.3)
    np.testing.assert_allclose(np.ptp(written.vertices, axis=0), [0.04, 0.06, 0.08], atol=1e-6)
    np.testing.assert_allclose(written.middle, np.zeros(3) if is_far else offset, atol=1e-6)
    np.testing.assert_allclose(written.center_of_mass, written.middle, atol=1e-5)
    assert ("simulated in a frame at its middle, [1.2, -1.0, 0.7] m in the file's" in caplog.text) == is_far


def test_the_simulated_body_has_the_mass_and_inertia_of_the_model(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.03, 0.06, 0.11))
    mesh.apply_transform(RigidTransform(RollPitchYaw(0.5, -0.3, 0.8), [0.01, -0.02, 0.03]).GetAsMatrix4())
    model = ObjectModel.from_mesh(mesh, mass=0.4, name="turned", cache=False)
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModels(str(write_simulated_object(model, tmp_path)))
    plant.Finalize()
    spatial = plant.GetBodyByName("turned").default_spatial_inertia()
    assert spatial.get_mass() == pytest.approx(0.4, rel=1e-5)
    np.testing.assert_allclose(spatial.get_com(), [0.01, -0.02, 0.03], atol=2e-6)
    about_middle = spatial.Shift(spatial.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    assert np.abs(model.inertia[np.triu_indices(3, 1)]).min() > 1e-5  # kg m^2, of which the trace has 1e-3
    np.testing.assert_allclose(about_middle, model.inertia, atol=1e-6 * np.trace(model.inertia))
