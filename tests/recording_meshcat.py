"""A stand-in for Meshcat that remembers what it is told."""

import numpy as np
from pydrake.math import RigidTransform


class RecordingMeshcat:
    """Holds the last transform and property of each path, and the paths that have an object."""

    def __init__(self) -> None:
        self.transforms: dict[str, RigidTransform] = {}
        self.properties: dict[tuple[str, str], object] = {}
        self.objects: dict[str, object] = {}
        self.times: set[float | None] = set()
        self.cameras: list[np.ndarray] = []

    def Delete(self, path: str) -> None:
        for held in (self.transforms, self.objects):
            for key in [key for key in held if key == path or key.startswith(path + "/")]:
                del held[key]

    def HasPath(self, path: str) -> bool:
        held = (*self.transforms, *self.objects)
        return any(key == path or key.startswith(path + "/") for key in held)

    def SetObject(self, path: str, shape: object, rgba: object) -> None:
        self.objects[path] = shape

    def SetTriangleMesh(
        self, path: str, vertices: np.ndarray, faces: np.ndarray, rgba: object, **wireframe: object
    ) -> None:
        self.objects[path] = (vertices, faces, rgba)

    def SetTransform(self, path: str, pose: RigidTransform, time: float | None = None) -> None:
        self.transforms[path] = pose
        self.properties.pop((path, "scale"), None)  # As a live page does.
        self.times.add(time)

    def SetProperty(self, path: str, name: str, value: object, time: float | None = None) -> None:
        self.properties[path, name] = value

    def SetCameraPose(self, camera: np.ndarray, target: np.ndarray) -> None:
        self.camera, self.target = camera, target
        self.cameras.append(camera)

    def pose(self, path: str) -> RigidTransform:
        """Of a path in the world: the product along it."""
        parts = path.strip("/").split("/")
        X = RigidTransform()
        for end in range(1, len(parts) + 1):
            X = X @ self.transforms.get("/" + "/".join(parts[:end]), RigidTransform())
        return X

    def visible(self, path: str) -> bool:
        """Whether neither the path nor one above it is hidden."""
        parts = path.strip("/").split("/")
        ends = ("/" + "/".join(parts[:end]) for end in range(1, len(parts) + 1))
        return all(self.properties.get((end, "visible"), True) for end in ends)
