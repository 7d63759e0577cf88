import numpy as np
import pytest

from tactopose_drake.core.vision.rasterizer import Camera, DrawnSurface, render

UP = np.array([0.0, 0.0, 1.0])
TOWARDS = np.array([0.0, -1.0, 0.0])  # the camera is at -y and sees x to the right, z upwards


def square(y: float, half: float, colour: tuple[float, float, float]) -> DrawnSurface:
    """A square across the line of sight, facing the camera."""
    vertices = np.array([[-half, y, -half], [half, y, -half], [half, y, half], [-half, y, half]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    return DrawnSurface(vertices, np.tile(TOWARDS, (4, 1)), faces, np.tile(colour, (4, 1)))


def both(a: DrawnSurface, b: DrawnSurface) -> DrawnSurface:
    return DrawnSurface(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.normals, b.normals]),
        np.concatenate([a.faces, b.faces + np.int32(len(a.vertices))]),
        np.concatenate([a.colour, b.colour]),
    )


def camera_for(surface: DrawnSurface, width: int = 100, height: int = 80) -> Camera:
    return Camera.framing(surface.vertices, TOWARDS, UP, width, height)


RED, GREEN = square(0.0, 1.0, (1.0, 0.0, 0.0)), square(-1.0, 0.3, (0.0, 1.0, 0.0))


@pytest.mark.parametrize("order", [(RED, GREEN), (GREEN, RED)])
def test_the_nearer_surface_hides_the_farther_whatever_their_order(order: tuple[DrawnSurface, DrawnSurface]) -> None:
    layer = render(both(*order), camera_for(RED))
    centre, edge = layer.colour[40, 50], layer.colour[40, 20]
    assert centre[1] > centre[0]
    assert edge[0] > edge[1]


def test_the_depth_is_the_distance_along_the_line_of_sight() -> None:
    camera = camera_for(RED)
    layer = render(both(RED, GREEN), camera)
    assert 1 / layer.inverse_depth[40, 20] - 1 / layer.inverse_depth[40, 50] == pytest.approx(1.0, rel=1e-4)
    assert 1 / layer.inverse_depth[40, 20] == pytest.approx(camera.X_CP[2, 3], rel=1e-4)


def test_a_tilted_plane_has_the_depth_of_perspective() -> None:
    vertices = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [-1.0, -1.0, 1.0]])
    surface = DrawnSurface(vertices, np.tile(TOWARDS, (4, 1)), RED.faces, np.ones((4, 3)))
    camera = camera_for(surface)
    layer = render(surface, camera)
    row, column = 40, 35
    # The plane is y = x; the ray through a pixel's centre is x = slope * depth.
    slope, offset = (column + 0.5 - 50) / camera.focal_length, camera.X_CP[:, 3]
    depth = (offset[2] - offset[0]) / (1 - slope)
    assert 1 / layer.inverse_depth[row, column] == pytest.approx(depth, rel=1e-4)


def test_a_pixel_on_a_shared_edge_has_no_hole() -> None:
    layer = render(RED, camera_for(RED))
    rows, columns = np.nonzero(layer.covered)
    assert layer.covered[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1].all()


@pytest.mark.parametrize("direction", [(0, -1, 0), (1, -1, 0.7), (-0.3, 0.2, 1.0)])
@pytest.mark.parametrize(("width", "height"), [(100, 80), (60, 120)])
def test_a_framed_cloud_fills_the_image_within_its_margin(direction, width: int, height: int) -> None:
    points = np.random.default_rng(0).normal(size=(300, 3)) * [0.1, 0.02, 0.3] + [5, 6, 7]
    camera = Camera.framing(points, np.array(direction, dtype=float), UP, width, height)
    p_C = points @ camera.X_CP[:, :3].T + camera.X_CP[:, 3]
    pixels = camera.focal_length * p_C[:, :2] / p_C[:, 2:] + 0.5 * np.array([width, height])
    assert np.all(p_C[:, 2] > 0)
    assert np.all(pixels > 0)
    assert np.all(pixels < [width, height])
    assert np.max(np.ptp(pixels, axis=0) / [width, height]) > 0.8
    np.testing.assert_allclose(camera.X_CP[:, :3] @ camera.X_CP[:, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.X_CP[:, :3]) == pytest.approx(1.0)


def test_up_is_up_and_right_is_right() -> None:
    layer = render(both(RED, square(-1.0, 0.3, (0, 1, 0))), camera_for(RED))
    raised = both(RED, DrawnSurface(GREEN.vertices + np.array([0.5, 0, 0.5]), GREEN.normals, GREEN.faces, GREEN.colour))
    moved = render(raised, camera_for(RED))
    green = [np.argwhere(image.colour[..., 1] > 0.3).mean(axis=0) for image in (layer, moved)]
    assert green[1][0] < green[0][0]  # a smaller row is higher up
    assert green[1][1] > green[0][1]


def test_what_is_behind_the_camera_is_not_drawn() -> None:
    camera = camera_for(RED)
    behind = DrawnSurface(RED.vertices - 2 * camera.X_CP[2, 3] * UP[[0, 2, 1]], RED.normals, RED.faces, RED.colour)
    assert not render(behind, camera).covered.any()


def test_a_surface_seen_from_its_inside_is_lit_like_its_outside() -> None:
    inside = DrawnSurface(RED.vertices, -RED.normals, RED.faces, RED.colour)
    np.testing.assert_array_equal(render(inside, camera_for(RED)).colour, render(RED, camera_for(RED)).colour)
