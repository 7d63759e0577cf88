import numpy as np
import pytest
import trimesh

from tactopose_drake.core.mesh import bodies as mesh_bodies
from tactopose_drake.core.mesh import topology as mesh_topology
from tactopose_drake.core.mesh.bodies import DebrisParams
from tests.core.meshes import ball, create, cube, inside_out, joined

BIG, SMALL = 0.06, 0.02
RING = create.torus(0.05, 0.02)


def arranged(mesh: trimesh.Trimesh, **params: float) -> tuple[trimesh.Trimesh, list[str]]:
    repairs: list[str] = []
    vertices, faces = mesh_bodies.arrange(
        np.array(mesh.vertices), np.array(mesh.faces), repairs, DebrisParams(**params)
    )
    return trimesh.Trimesh(vertices, faces, process=False), repairs


def test_volumes_are_signed_and_by_body() -> None:
    mesh = joined(cube(BIG, (5.0, 5.0, 5.0)), inside_out(cube(SMALL)))
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    body = mesh_topology.body_labels(faces)
    np.testing.assert_allclose(mesh_bodies.volumes(vertices, faces, body), [BIG**3, -(SMALL**3)])
    np.testing.assert_allclose(mesh_bodies.volumes(vertices, faces), [BIG**3 - SMALL**3])


CASES = {
    "one": (cube(BIG), BIG**3, []),
    "inside_out": (inside_out(ball()), ball().volume, ["flipped the mesh, turned inside out"]),
    "cavity": (joined(cube(BIG), inside_out(cube(SMALL))), BIG**3 - SMALL**3, []),
    "all_inside_out_with_cavity": (
        joined(inside_out(cube(BIG)), cube(SMALL)),
        BIG**3 - SMALL**3,
        ["flipped the mesh, turned inside out"],
    ),
    "island_in_a_cavity": (
        joined(cube(BIG), inside_out(cube(0.04)), cube(SMALL)),
        BIG**3 - 0.04**3 + SMALL**3,
        ["kept 2 separate bodies as one rigid object"],
    ),
    "nested": (joined(cube(BIG), cube(SMALL)), BIG**3, ["united 2 overlapping bodies"]),
    "overlapping": (
        joined(cube(BIG), cube(BIG, (0.03, 0.01, 0.02))),
        2 * BIG**3 - 0.03 * 0.05 * 0.04,
        ["united 2 overlapping bodies"],
    ),
    "overlapping_with_cavity": (
        joined(cube(BIG), inside_out(cube(0.01)), cube(BIG, (0.05, 0.0, 0.0))),
        2 * BIG**3 - 0.01 * BIG**2 - 0.01**3,
        ["united 2 overlapping bodies"],
    ),
    "apart": (joined(cube(BIG), cube(BIG, (0.1, 0, 0))), 2 * BIG**3, ["kept 2 separate bodies as one rigid object"]),
    "inside_out_in_a_ring": (
        joined(RING, inside_out(cube(SMALL))),
        RING.volume + SMALL**3,
        ["flipped 1 body, turned inside out", "kept 2 separate bodies as one rigid object"],
    ),
    "one_of_two_inside_out": (
        joined(cube(BIG), inside_out(cube(0.04, (0.1, 0, 0)))),
        BIG**3 + 0.04**3,
        ["flipped 1 body, turned inside out", "kept 2 separate bodies as one rigid object"],
    ),
    "debris": (
        joined(cube(BIG), cube(0.003, (0.1, 0, 0)), inside_out(cube(0.003))),
        BIG**3,
        ["dropped 2 separate pieces of less than 0.1 % of the volume"],
    ),
}


@pytest.mark.parametrize(("mesh", "volume", "expected"), CASES.values(), ids=CASES)
def test_bodies_become_one_solid(mesh: trimesh.Trimesh, volume: float, expected: list[str]) -> None:
    solid, repairs = arranged(mesh)
    assert repairs == expected
    assert solid.is_watertight
    np.testing.assert_allclose(solid.volume, volume, rtol=1e-9)


def test_many_bodies_in_reasonable_time() -> None:
    places = np.stack(np.meshgrid(*[np.arange(6)] * 3), axis=-1).reshape(-1, 3) * 0.03
    solid, repairs = arranged(joined(*[cube(SMALL, place) for place in places]))
    assert repairs == ["kept 216 separate bodies as one rigid object"]
    np.testing.assert_allclose(solid.volume, 216 * SMALL**3)


def test_what_is_debris_may_be_less() -> None:
    speck = joined(cube(BIG), cube(0.004, (0.1, 0, 0)))
    assert arranged(speck)[1] == ["dropped 1 separate piece of less than 0.1 % of the volume"]
    assert arranged(speck, share=1e-4)[1] == ["kept 2 separate bodies as one rigid object"]
    lump = joined(cube(BIG), cube(0.015, (0.1, 0, 0)))
    assert arranged(lump, share=0.02)[1] == ["kept 2 separate bodies as one rigid object"]
    assert arranged(lump, share=0.02, total_share=0.1)[1] == ["dropped 1 separate piece of less than 2 % of the volume"]
