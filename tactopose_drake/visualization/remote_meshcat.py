"""A client of a running meshcat-server with Drake's Meshcat methods; Drake's Meshcat can only be a server itself."""

import importlib
import warnings
from types import ModuleType
from typing import Any, Self

import numpy as np
import trimesh
import umsgpack
import zmq
from pydrake.geometry import Box, Cylinder, MeshcatCone, Rgba, Shape, Sphere
from pydrake.math import RigidTransform

from tactopose_drake.core.validation import FloatArray, kind_name
from tactopose_drake.errors import InvalidInputError

_ANSWER_TIME = 2000  # timeout of an answer, ms


class RemoteMeshcat:
    """The drawing methods of Drake's Meshcat, for a server of the PyPI package `meshcat`.

    All browsers connected to that server show the drawing. Its camera and background are not changed. It is a context
    manager, which disconnects at its end.
    """

    def __init__(self, url: str) -> None:
        """Connects to a server.

        Args:
            url: URL of the server's ZeroMQ socket, such as tcp://127.0.0.1:6000; `meshcat-server` prints it.

        Raises:
            InvalidInputError: if the URL is invalid, or no meshcat-server answers there.
        """
        self._connection = _Connection(url)
        self._client = _client()
        self._visualizer = self._client.Visualizer(window=self._connection)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def web_url(self) -> str:
        """The URL for a web browser."""
        return self._connection.web_url

    def Delete(self, path: str) -> None:
        """Deletes the path and all below it."""
        self._at(path).delete()

    def SetObject(self, path: str, shape: Shape, rgba: Rgba) -> None:
        """Draws a sphere, a cylinder, a box or a cone."""
        mesh = _mesh(shape)
        self.SetTriangleMesh(path, mesh.vertices.T, mesh.faces.T, rgba)

    def SetTriangleMesh(self, path: str, vertices: FloatArray, faces: np.ndarray[Any, Any], rgba: Rgba) -> None:
        """Draws a triangle mesh of vertices (3, v), m, and faces (3, f)."""
        channels = [round(255 * channel) for channel in (rgba.r(), rgba.g(), rgba.b())]
        geometry = self._client.geometry
        material = geometry.MeshPhongMaterial(
            color=channels[0] << 16 | channels[1] << 8 | channels[2],
            opacity=rgba.a(),
            transparent=rgba.a() < 1.0,
            side=2,  # both, as Drake does
        )
        self._at(path).set_object(geometry.TriangularMeshGeometry(vertices.T, faces.T), material)

    def SetTransform(self, path: str, X_ParentPath: RigidTransform, time_in_recording: float | None = None) -> None:
        """Sets the pose of the path in its parent's frame; the time is ignored, because there is no recording."""
        self._at(path).set_transform(X_ParentPath.GetAsMatrix4())

    def SetProperty(self, path: str, name: str, value: Any, time_in_recording: float | None = None) -> None:
        """Sets a property of the path; the time is ignored, because there is no recording."""
        self._at(path).set_property(name, value)

    def _at(self, path: str) -> Any:
        return self._visualizer[path.strip("/")]


def _client() -> ModuleType:
    """The package `meshcat`, imported on demand: it imports IPython, which takes half a second, and gives warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return importlib.import_module("meshcat")


class _Connection:
    """The connection to a server; the one of the package `meshcat` would wait for an answer forever."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        try:
            self._socket.connect(url)
            self.web_url = self._ask(b"url").decode()
        except zmq.ZMQError as error:
            self.close()
            raise InvalidInputError(
                f"meshcat URL must be one such as tcp://127.0.0.1:6000, not {url!r} ({error})."
            ) from error
        except InvalidInputError:
            self.close()
            raise

    def send(self, command: Any) -> None:
        """Sends one of the client's commands."""
        data = command.lower()
        self._ask(data["type"].encode(), data["path"].encode(), umsgpack.packb(data))

    def close(self) -> None:
        """Disconnects."""
        self._socket.close()

    def _ask(self, *frames: bytes) -> bytes:
        self._socket.send_multipart(frames)
        if not self._socket.poll(_ANSWER_TIME):
            raise InvalidInputError(f"meshcat URL: no meshcat-server answers at {self._url}.")
        return self._socket.recv()


def _mesh(shape: Shape) -> trimesh.Trimesh:
    """A shape as triangles, in the frame in which Drake defines it."""
    mesh: trimesh.Trimesh
    if isinstance(shape, Sphere):
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=shape.radius())
    elif isinstance(shape, Cylinder):
        mesh = trimesh.creation.cylinder(radius=shape.radius(), height=shape.length(), sections=24)
    elif isinstance(shape, Box):
        mesh = trimesh.creation.box(shape.size())
    elif isinstance(shape, MeshcatCone):
        mesh = trimesh.creation.cone(radius=1.0, height=1.0, sections=24)
        # Drake's cone stands on its tip: flipping two axes keeps the faces outward.
        mesh.vertices = (mesh.vertices - [0.0, 0.0, 1.0]) * [shape.a(), -shape.b(), -shape.height()]
    else:
        raise InvalidInputError(f"shape must be a Sphere, Cylinder, Box or MeshcatCone, not {kind_name(type(shape))}.")
    return mesh
