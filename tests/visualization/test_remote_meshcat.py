import gc
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import umsgpack
import zmq
from pydrake.geometry import Cylinder, Ellipsoid, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.errors import InvalidInputError
from tactopose_drake.resources import model_path
from tactopose_drake.visualization import remote_meshcat
from tactopose_drake.visualization.meshcat import draw_scene
from tactopose_drake.visualization.remote_meshcat import RemoteMeshcat
from tactopose_drake.visualization.scene import Scene, ShownHypothesis


class Server:
    """Answers as meshcat-server does, and keeps what it was told by path."""

    def __init__(self, socket: zmq.Socket[bytes]) -> None:
        self.url = f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"
        self.told: list[dict[str, Any]] = []
        self._socket, self._over = socket, threading.Event()
        gc.collect()  # A Meshcat that earlier tests have left must end on this thread.
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.is_set():
            if not self._socket.poll(20):
                continue
            frames = self._socket.recv_multipart()
            if len(frames) == 3:
                self.told.append(umsgpack.unpackb(frames[2]))
            self._socket.send(b"http://127.0.0.1:7000/static/" if frames == [b"url"] else b"ok")

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def of(self, kind: str) -> dict[str, dict[str, Any]]:
        return {command["path"]: command for command in self.told if command["type"] == kind}


@pytest.fixture
def server() -> Iterator[Server]:
    with zmq.Context() as context, context.socket(zmq.REP) as socket:
        running = Server(socket)
        yield running
        running.close()


def vertices(command: dict[str, Any]) -> np.ndarray:
    (geometry,) = command["object"]["geometries"]
    return np.frombuffer(geometry["data"]["attributes"]["position"]["array"].data, dtype=np.float32).reshape(-1, 3)


def test_a_scene_goes_to_the_server_where_drake_would_put_it(server: Server) -> None:
    model = ObjectModel.from_mesh(model_path("objects", "cube.obj"))
    X_PO = RigidTransform(RotationMatrix.MakeZRotation(0.5), [0.1, 0.2, 0.3])
    contacts = Contacts([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]], [[0.0, 0.0, 2.0]])
    with RemoteMeshcat(server.url) as meshcat:
        assert meshcat.web_url() == "http://127.0.0.1:7000/static/"
        draw_scene(meshcat, Scene(model=model, contacts=contacts, hypotheses=(ShownHypothesis(X_PO),)))

    objects, transforms = server.of("set_object"), server.of("set_transform")
    estimate = next(path for path in objects if path.endswith("tactopose/estimate"))
    np.testing.assert_allclose(
        np.abs(vertices(objects[estimate])).max(axis=0), np.abs(model.vertices).max(axis=0), atol=1e-3
    )
    matrix = np.reshape(transforms[estimate]["matrix"], (4, 4)).T
    np.testing.assert_allclose(matrix, X_PO.GetAsMatrix4(), atol=1e-6)
    assert any(path.endswith("touch/0/force/head") for path in objects)
    # The owner of the server keeps the camera and the background.
    assert not [path for path in server.of("set_property") if "Background" in path or "Cameras" in path]


@pytest.mark.parametrize(
    ("shape", "low", "high"),
    [
        (Sphere(0.5), [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]),
        (Cylinder(0.5, 2.0), [-0.5, -0.5, -1.0], [0.5, 0.5, 1.0]),
        (MeshcatCone(2.0, 0.5, 0.25), [-0.5, -0.25, 0.0], [0.5, 0.25, 2.0]),
    ],
)
def test_shapes_lie_as_drake_has_them(server: Server, shape: object, low: list[float], high: list[float]) -> None:
    with RemoteMeshcat(server.url) as meshcat:
        meshcat.SetObject("/a/shape", shape, Rgba(1.0, 0.5, 0.0, 0.3))
    (command,) = server.of("set_object").values()
    points = vertices(command)
    np.testing.assert_allclose(points.min(axis=0), low, atol=0.03)
    np.testing.assert_allclose(points.max(axis=0), high, atol=0.03)
    (material,) = command["object"]["materials"]
    assert material["color"] == 0xFF8000
    assert material["opacity"] == pytest.approx(0.3)
    if isinstance(shape, MeshcatCone):
        assert np.hypot(*points[np.argmin(points[:, 2]), :2]) == pytest.approx(0.0, abs=1e-6)  # on its tip


def test_a_cone_stands_on_its_tip_with_its_outside_outside(monkeypatch: pytest.MonkeyPatch, server: Server) -> None:
    drawn: list[tuple[np.ndarray, np.ndarray]] = []
    with RemoteMeshcat(server.url) as remote:
        monkeypatch.setattr(remote, "SetTriangleMesh", lambda path, v, f, rgba: drawn.append((v.T, f.T)))
        remote.SetObject("/cone", MeshcatCone(0.3, 0.1, 0.2), Rgba(1.0, 0.0, 0.0))
    ((vertices, faces),) = drawn
    at_tip, at_end = vertices[:, 2] < 0.01, vertices[:, 2] > 0.29
    np.testing.assert_allclose(vertices[at_tip, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(vertices[at_end, :2]).max(axis=0), [0.1, 0.2], rtol=1e-6)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6.0 > 0.9 * np.pi * 0.1 * 0.2 * 0.3 / 3.0


def test_other_shapes_are_an_error(server: Server) -> None:
    with (
        RemoteMeshcat(server.url) as meshcat,
        pytest.raises(
            InvalidInputError, match="shape must be a Sphere, Cylinder, Box or MeshcatCone, not an Ellipsoid"
        ),
    ):
        meshcat.SetObject("/a", Ellipsoid(1, 1, 1), Rgba(1, 1, 1))


def test_no_server_is_an_error_and_not_a_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote_meshcat, "_ANSWER_TIME", 50)
    with pytest.raises(InvalidInputError, match=r"no meshcat-server answers at tcp://127\.0\.0\.1:1"):
        RemoteMeshcat("tcp://127.0.0.1:1")


def test_a_url_that_is_none_is_an_error() -> None:
    with pytest.raises(InvalidInputError, match=r"meshcat URL must be one such as .*, not 'nonsense'"):
        RemoteMeshcat("nonsense")
