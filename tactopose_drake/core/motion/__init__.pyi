from .object_motion import MotionNoise as MotionNoise
from .object_motion import move_freely as move_freely
from .object_motion import move_with_fingertips as move_with_fingertips
from .object_motion import move_with_palm as move_with_palm
from .rigid_motion import Motion as Motion
from .rigid_motion import MotionHistory as MotionHistory
