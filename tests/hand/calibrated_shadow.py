"""A Shadow-like hand that is off by known errors, and grasps of a body by it."""

import dataclasses

import numpy as np

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.hand.closed_grasps import ClosedGrasp, ClosedGraspParams, GraspCloser
from tactopose_drake.hand.fingertip_surfaces import SkinLayer
from tactopose_drake.hand.hand_config import HandConfig, HandUncertainty, load_hand_config
from tactopose_drake.hand.hand_errors import HandErrors
from tactopose_drake.hand.hand_in_plant import make_hand_plant
from tactopose_drake.hand.recorded_grasps import RecordedGrasp

SOFT = SkinLayer(thickness=0.002, stiffness=4000.0)
UNCERTAINTY = HandUncertainty(
    encoder_offset_deg=2.0,
    fingertip_radius=0.001,
    sensor_force=0.1,
    sensor_moment=0.001,
    mounting=0.0,
    mounting_deg=0.0,
)


class WrongHand:
    """A hand whose errors are drawn at random."""

    def __init__(
        self,
        seed: int,
        uncertainty: HandUncertainty = UNCERTAINTY,
        span: float = 0.0,
        layer: SkinLayer | None = None,
    ) -> None:
        shadow = load_hand_config("shadow_like")
        fingers = [dataclasses.replace(finger, layer=layer) for finger in shadow.fingers]
        self.config: HandConfig = dataclasses.replace(shadow, uncertainty=uncertainty, fingers=fingers)
        self.plant, self.hand = make_hand_plant(self.config)
        self.errors = HandErrors.of(self.plant, self.hand, uncertainty, span)
        self.generator = np.random.default_rng(seed)
        self.truth = self.errors.sigma * self.generator.normal(size=len(self.errors.sigma))

    def close(
        self, model: ObjectModel, count: int, params: ClosedGraspParams | None = None, times: list[float] | None = None
    ) -> list[ClosedGrasp]:
        """Grasps of an object."""
        closer = GraspCloser(self.plant, self.hand, self.errors, self.truth, params)
        return [closer.grasp(model, self.generator, None if times is None else times[i]) for i in range(count)]

    def error(self, name: str) -> float:
        """One of its errors, SI units."""
        return float(self.truth[self.errors.names.index(name)])


def shifted(grasp: RecordedGrasp, by: float) -> RecordedGrasp:
    """The same grasp with readings that are wrong, each joint's otherwise, rad."""
    joints = {name: value + by * (-1) ** k for k, (name, value) in enumerate(grasp.joint_positions.items())}
    return dataclasses.replace(grasp, joint_positions=joints)
