"""A pose estimator with fixed inputs, and the box that is touched."""

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.collision import HandCollision
from tactopose_drake.systems.pose_estimator import PoseEstimator, PoseEstimatorParams
from tests.core.models import brick

X_PO = RigidTransform(RollPitchYaw(0.4, -0.2, 1.0), [0.02, -0.03, 0.1])


class Bench:
    """An estimator with fixed inputs, and a simulator that steps it once per call."""

    def __init__(
        self, model: ObjectModel, collision: HandCollision | None = None, pads: int = 0, **params: object
    ) -> None:
        self.estimator = PoseEstimator(model, PoseEstimatorParams(period=0.1, **params), collision, pads)
        self.estimator.set_name("estimator")
        self.simulator = Simulator(self.estimator)
        self.context: Context = self.simulator.get_mutable_context()

    def fix(self, **inputs: object) -> None:
        for name, value in inputs.items():
            self.estimator.GetInputPort(name).FixValue(self.context, AbstractValue.Make(value))

    def step(self) -> tuple[RigidTransform, object, str]:
        self.simulator.AdvanceTo(self.context.get_time() + 0.1)
        return self.read()

    def read(self) -> tuple[RigidTransform, object, str]:
        return tuple(
            self.estimator.GetOutputPort(name).Eval(self.context) for name in ("object_pose", "hypotheses", "status")
        )


def make_box() -> ObjectModel:
    return brick(0.06, 0.10, 0.14)
