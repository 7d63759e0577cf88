"""What the tracker of a pose assumes."""

import dataclasses

from tactopose_drake.core.tracking.object_motion import MotionNoise
from tactopose_drake.core.validation import instance_of, positive_number, whole_number


@dataclasses.dataclass(kw_only=True, slots=True)
class PoseTrackerParams:
    """What the belief assumes of the hand and of the motion, and how much it works."""

    calibration_position: float = 0.0005  # the part of a contact's error that never changes, of each coordinate, m
    calibration_normal_deg: float = 2.5  # likewise of its normal about each axis, deg
    surface_position: float = 0.0001  # how far the model's surface is from the object's, m
    surface_normal_deg: float = 1.0  # how far its normals are about each axis, deg
    noise: MotionNoise = dataclasses.field(default_factory=MotionNoise)
    max_modes: int = 8  # kept at the most
    least_share: float = 1e-7  # of the mass of the best mode; less is dropped
    slip_time: float = 0.1  # s for which a slip that was found is taken to go on
    lost_time: float = 0.2  # s without an explanation of the touch, after which the pose is lost
    forget_time: float = 1.0  # s without touch or vision, after which the pose is lost
    memory_time: float = 0.3  # s after which what the touch told of the pose has faded
    search_period: float = 0.4  # s between two looks elsewhere, while all is well
    search_period_lost: float = 0.05  # s between two looks elsewhere, while it is not
    vision_time: float = 0.5  # s after which the error of vision is a new one; more frequent poses count less
    vision_memory: float = 1.0  # s; what vision saw earlier is of no use
    seed: int = 0  # of the searches' random numbers

    def validate(self) -> None:
        """Raises InvalidInputError if a number is out of its range."""
        instance_of("PoseTrackerParams.noise", self.noise, MotionNoise)
        self.noise.validate()
        for field in dataclasses.fields(self):
            if isinstance(field.default, float):
                positive_number(f"PoseTrackerParams.{field.name}", getattr(self, field.name))
        for name, least in (("max_modes", 1), ("seed", 0)):
            whole_number(f"PoseTrackerParams.{name}", getattr(self, name), least=least)
