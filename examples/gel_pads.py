"""The pose of a bust in a two-finger gripper, from the height maps of two gel pads and a camera's estimate.

The pads have 15 by 20 mm and 240 by 320 pixels, like those of a GelSight Mini; their height maps are computed from the
bust's distance field. The poses of the pads in the palm are off by half a millimetre and a degree.
"""

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.poses import exp_so3, increments_between, make_poses, retract
from tactopose_drake.core.sensing import HeightMapSensor
from tactopose_drake.core.synthetic import press_gel
from tactopose_drake.resources import model_path

PIXELS, PRESSED = (240, 320), 0.0008  # rows and columns; how deep the fingers press, m


def pad_pose(side: int, half_opening: float) -> np.ndarray:
    """Pose of a pad on one side, -1 or 1, that faces inwards along x of the palm; its rows are along y."""
    z = np.array([-side, 0.0, 0.0])
    return make_poses(np.column_stack([[0.0, 1.0, 0.0], np.cross(z, [0.0, 1.0, 0.0]), z]), -z * half_opening)


def close(model: tp.ObjectModel, X_PO: np.ndarray, side: int, generator: np.random.Generator) -> tuple:
    """Moves a finger inwards until it presses as deep as `PRESSED`; returns the pad's true pose and height map."""
    for half_opening in np.arange(0.06, 0.0, -0.0002):
        X_PT = pad_pose(side, half_opening)
        depth = press_gel(model, X_PO, X_PT, SENSOR, PIXELS, generator)
        if depth.max() >= PRESSED:
            return X_PT, depth
    raise RuntimeError("the finger closes beside the object")


SENSOR = HeightMapSensor(pixel=6.34e-5)  # m
generator = np.random.default_rng(0)
model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
X_PO = make_poses(exp_so3(np.array([0.4, -0.2, 0.5])), np.array([0.002, 0.003, -0.06]))
patches = []
for side in (-1, 1):
    X_PT, depth = close(model, X_PO, side, generator)
    error = np.concatenate([generator.normal(size=3) * np.radians(1.0), generator.normal(size=3) * 0.0005])
    patches.append(SENSOR.patch(depth, retract(X_PT, error), mask=depth > 0.0))

X_PO_seen = retract(X_PO, np.array([0.15, -0.1, 0.12, 0.012, -0.014, 0.01]))  # as a camera has it
prior = tp.PosePrior(X_PO_seen, sigma_translation=0.015, sigma_rotation=np.radians(10.0))
estimate = tp.estimate_pose(model, tp.Contacts.empty(), patches=patches, prior=prior)
X_PO_hat, free = estimate.best.X_PO.GetAsMatrix34(), estimate.best.free_directions
for name, X in (("seen", X_PO_seen), ("felt", X_PO_hat)):
    off = increments_between(X, X_PO)
    off -= free.T @ (free @ off)  # where the touch determines it
    print(f"{name}: off by {1e3 * np.linalg.norm(off[3:]):.1f} mm, {np.degrees(np.linalg.norm(off[:3])):.1f} deg")
print(estimate.status, *(f"{patch.active.sum()} of {len(patch.p_PT)} cells touched" for patch in patches), sep=", ")
