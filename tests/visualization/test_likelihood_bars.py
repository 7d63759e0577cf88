"""Likelihoods as bars: where each begins and how long it is."""

import pytest
from pydrake.geometry import Box

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.estimation.identities import Identification, Identity
from tactopose_drake.visualization.likelihood_bars import HEIGHT, LENGTH, add_bars, row_path, set_bars
from tests.recording_meshcat import RecordingMeshcat


def test_each_bar_begins_at_its_shape_and_is_as_long_as_its_likelihood(model: ObjectModel, blob: ObjectModel) -> None:
    models, meshcat = (blob, model), RecordingMeshcat()
    add_bars(meshcat, "/bars", models)  # type: ignore[arg-type]
    identities = [
        Identity(each.name, row, row + 1, likelihood, 0.5 * likelihood, -1.0, None)
        for row, (each, likelihood) in enumerate(zip(models, (0.8, 0.2), strict=True))
    ]
    for found, likelihoods in ((None, (1e-3, 1e-3)), (Identification(tuple(identities), "ok", 0.1, 0.5), (0.8, 0.2))):
        set_bars(meshcat, "/bars", models, found, 0.0)  # type: ignore[arg-type]
        for row, (each, likelihood) in enumerate(zip(models, likelihoods, strict=True)):
            bar = f"{row_path('/bars', row, each.name)}/bar"
            box = meshcat.objects[f"{bar}/box"]
            assert isinstance(box, Box)
            length = box.depth() * meshcat.properties[f"{bar}/box", "scale"][1]  # type: ignore[index]
            assert length == pytest.approx(LENGTH * likelihood)
            begin = meshcat.pose(bar).translation() - [0.0, 0.5 * length, 0.0]
            assert begin == pytest.approx([0.0, HEIGHT, -HEIGHT * row])
