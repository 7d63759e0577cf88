from .guarded_moves import GuardedMoves as GuardedMoves
from .next_touch import Hold as Hold
from .next_touch import SafetyParams as SafetyParams
from .next_touch import choose_touch as choose_touch
from .next_touch import is_allowed as is_allowed
