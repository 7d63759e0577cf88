"""Models from what Drake simulates."""

from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.resources import model_path

SDF = """<sdf version="1.9"><model name="hammer"><link name="hammer">
<inertial><pose>0 0 0.05 0 0 0</pose><mass>0.4</mass>
<inertia><ixx>1e-3</ixx><iyy>1e-3</iyy><izz>1e-4</izz></inertia></inertial>
<collision name="handle">
<geometry><cylinder><radius>0.012</radius><length>0.2</length></cylinder></geometry></collision>
<collision name="head"><pose>0 0 0.1 0 0 0</pose><geometry><box><size>0.1 0.03 0.03</size></box></geometry></collision>
{more}</link></model></sdf>"""


def test_primitives_of_an_sdf_become_one_body(tmp_path: Path) -> None:
    path = tmp_path / "hammer.sdf"
    path.write_text(SDF.format(more=""))
    model = load_object(path)
    assert model.name == "hammer"
    assert model.mass == pytest.approx(0.4)
    np.testing.assert_allclose(model.center_of_mass, [0, 0, 0.05])
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    np.testing.assert_allclose([low, high], [[-0.05, -0.015, -0.1], [0.05, 0.015, 0.115]], atol=1e-6)
    overlap = np.pi * 0.012**2 * 0.015  # of the handle's end in the head
    assert model.volume == pytest.approx(np.pi * 0.012**2 * 0.2 + 0.1 * 0.03**2 - overlap, rel=5e-3)


def test_a_shipped_sdf_is_its_mesh() -> None:
    model = load_object(model_path("objects", "mug.sdf"))
    of_mesh = load_object(model_path("objects", "mug.obj"))
    assert model.volume == pytest.approx(of_mesh.volume)
    assert model.mass == pytest.approx(0.32)
    assert load_object(model_path("objects", "mug.obj"), scale=0.5).size == pytest.approx(0.5 * of_mesh.size)


@pytest.mark.parametrize(
    ("more", "scale", "text"),
    [
        ("", 0.001, "is in metres; a scale is for meshes alone"),
        ('</link><link name="other">', 1.0, "holds 2 links; allowed is one"),
        ('<collision name="floor"><geometry><plane/></geometry></collision>', 1.0, "without an inside, a HalfSpace"),
    ],
)
def test_what_is_no_single_body_is_refused(tmp_path: Path, more: str, scale: float, text: str) -> None:
    path = tmp_path / "hammer.sdf"
    path.write_text(SDF.format(more=more))
    with pytest.raises(InvalidFileError, match=text):
        load_object(path, scale=scale)
