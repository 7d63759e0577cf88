"""The possible statuses of a pose, for estimates of one instant and for beliefs over time."""

from typing import Literal

Status = Literal["ok", "ambiguous", "no_solution"]
BeliefStatus = Literal["ok", "ambiguous", "slipping", "no_contact", "lost"]

# The status of an estimate that corresponds to each status of a belief.
STATUS_OF_BELIEF: dict[BeliefStatus, Status] = {
    "ok": "ok",
    "ambiguous": "ambiguous",
    "slipping": "ok",
    "no_contact": "no_solution",
    "lost": "no_solution",
}
