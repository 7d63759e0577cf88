"""The pose of a held bust from four contacts and a camera's estimate, in plain Python.

Contacts and the camera's estimate are those of `own_diagram.py`, where the bust is at p_PO = [-0.0588, -0.0240, 0.0582]
m; the camera's estimate is 28 mm and 18 degrees off.
"""

import math

from pydrake.math import RigidTransform, RollPitchYaw

import tactopose_drake as tp
from tactopose_drake.resources import model_path

p_PC = [[0.0400, -0.0681, 0.0897], [0.0122, -0.0542, 0.0744], [-0.0128, -0.0551, 0.0848], [-0.0270, -0.0562, 0.0698]]
n_PC = [[-0.775, -0.437, 0.456], [-0.135, -0.411, 0.902], [0.218, -0.967, 0.130], [-0.630, -0.714, 0.306]]
X_PO_camera = RigidTransform(RollPitchYaw(math.pi / 2, 0, math.pi / 2), [-0.05, -0.05, 0.065])

model = tp.ObjectModel.from_mesh(model_path("objects", "bust.obj"))
contacts = tp.Contacts(p_PC, n_PC)
prior = tp.PosePrior(X_PO_camera, sigma_translation=0.033)
estimate = tp.estimate_pose(model, contacts, prior=prior)
print(estimate.status, estimate.best.X_PO, estimate.best.free_directions)
