"""Models from what Drake simulates."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from tactopose_drake.core.mesh.repair import MeshRepairWarning
from tactopose_drake.errors import InvalidFileError, InvalidMeshError
from tactopose_drake.estimation.object_files import load_object
from tactopose_drake.estimation.simulated_body import read_body
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
        ("", 0.001, "scale must be 1, .*, not 0.001"),
        ('</link><link name="other">', 1.0, "must hold 1 link, not 2"),
        (
            '<collision name="floor"><geometry><plane/></geometry></collision>',
            1.0,
            "must have collision shapes with an inside, not a HalfSpace",
        ),
    ],
)
def test_what_is_no_single_body_is_refused(tmp_path: Path, more: str, scale: float, text: str) -> None:
    path = tmp_path / "hammer.sdf"
    path.write_text(SDF.format(more=more))
    with pytest.raises(InvalidFileError, match=text):
        load_object(path, scale=scale)


def claw(faces: slice = slice(None)) -> trimesh.Trimesh:
    """A body that no turn makes its mirror image, 44 cm^3: a bar along x with arms along y and z at its ends."""
    boxes = [
        trimesh.primitives.Box(extents, trimesh.transformations.translation_matrix(middle)).to_mesh()
        for extents, middle in (
            ((0.06, 0.02, 0.02), (0.0, 0.0, 0.0)),
            ((0.02, 0.04, 0.02), (0.02, 0.01, 0.0)),
            ((0.02, 0.02, 0.05), (-0.02, 0.0, 0.015)),
        )
    ]
    whole = trimesh.boolean.union(boxes, engine="manifold")
    return trimesh.Trimesh(whole.vertices, whole.faces[faces], process=False)


def write_claw(folder: Path, mesh: trimesh.Trimesh, scale: tuple[int, int, int], beside: str) -> Path:
    mesh.export(folder / "claw.obj")
    text = (
        '<collision name="claw"><geometry><mesh><uri>claw.obj</uri>'
        f"<scale>{' '.join(map(str, scale))}</scale></mesh></geometry></collision>{beside}"
    )
    path = folder / "claw.sdf"
    path.write_text(f'<sdf version="1.9"><model name="claw"><link name="claw">{text}</link></model></sdf>')
    return path


KNOB = """<collision name="knob"><pose>0 0 -0.02 0 0 0</pose>
<geometry><box><size>0.018 0.018 0.03</size></box></geometry></collision>"""


@pytest.mark.parametrize("beside", ["", KNOB])
@pytest.mark.parametrize("scale", [(1, 1, 1), (1, -1, 1), (-1, -1, 1), (-1, -1, -2)])
def test_a_mesh_in_an_sdf_is_scaled_and_mirrored_as_drake_does_it(
    tmp_path: Path, scale: tuple[int, int, int], beside: str
) -> None:
    shape = read_body(write_claw(tmp_path, claw(), scale, beside)).shape
    bounds = np.sort(np.array([[-0.03, -0.01, -0.01], [0.03, 0.03, 0.04]]) * scale, axis=0)
    volume = abs(np.prod(scale)) * 44e-6
    if beside:  # It ends 3.5 cm below the origin, and begins within the bar.
        volume += 0.018**2 * (0.035 - 0.01 * abs(scale[2]))
        bounds[0, 2] = min(bounds[0, 2], -0.035)
    np.testing.assert_allclose(shape.bounds, bounds, atol=1e-6)
    assert shape.volume == pytest.approx(volume, rel=1e-4)


def test_a_gltf_file_in_an_sdf_lies_as_drake_turns_it(tmp_path: Path) -> None:
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(claw())).items():
        (tmp_path / name).write_bytes(content)
    path = write_claw(tmp_path, claw(), (1, 2, 3), "")
    path.write_text(path.read_text().replace("claw.obj", "model.gltf"))
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    Parser(plant).AddModels(str(path))
    plant.Finalize()
    (geometry,) = plant.GetCollisionGeometriesForBody(plant.GetBodyByName("claw"))
    hull = scene_graph.model_inspector().GetConvexHull(geometry)
    corners = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
    shape = read_body(path).shape
    np.testing.assert_allclose(shape.bounds, [corners.min(axis=0), corners.max(axis=0)], atol=1e-6)
    assert shape.volume == pytest.approx(6 * 44e-6, rel=1e-4)


def test_a_mesh_whose_faces_share_no_vertices_is_united_with_what_is_beside_it(tmp_path: Path) -> None:
    apart = claw()
    apart.unmerge_vertices()
    path = write_claw(tmp_path, apart, (1, 1, 1), KNOB)
    assert path.with_suffix(".obj").read_text().count("\nv ") + 1 >= 3 * len(apart.faces)
    assert read_body(path).shape.volume == pytest.approx(44e-6 + 0.018**2 * 0.025, rel=1e-4)


def test_a_mesh_beside_other_shapes_is_repaired_with_a_statement_or_refused(tmp_path: Path) -> None:
    inside_out = claw()
    inside_out.invert()
    path = write_claw(tmp_path, inside_out, (1, 1, 1), KNOB)
    with pytest.warns(MeshRepairWarning, match="claw: flipped the mesh, turned inside out"):
        model = load_object(path)
    assert model.volume == pytest.approx(44e-6 + 0.018**2 * 0.025, rel=1e-4)
    path = write_claw(tmp_path, claw(slice(6)), (1, 1, 1), KNOB)
    with pytest.raises(InvalidMeshError, match=re.escape(str(path))):
        read_body(path)
