from .frame import Frame as Frame
from .frame import PoseMeasurement as PoseMeasurement
from .pose_belief import PoseBelief as PoseBelief
from .pose_tracker import PoseTracker as PoseTracker
from .tracker_params import PoseTrackerParams as PoseTrackerParams
