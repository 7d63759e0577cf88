from .rolling_touch import FingertipNoise as FingertipNoise
from .rolling_touch import RollingTouch as RollingTouch
from .synthetic_height_map import press_gel as press_gel
from .synthetic_patch import PadTouchParams as PadTouchParams
from .synthetic_patch import flat_pad as flat_pad
from .synthetic_patch import touch_with_pads as touch_with_pads
from .synthetic_touch import touch_surface as touch_surface
