"""The words for what a pose is worth: one list for the estimate of one instant and the belief over time."""

from typing import Literal

Status = Literal["ok", "ambiguous", "no_solution"]
BeliefStatus = Literal["ok", "ambiguous", "slipping", "no_contact", "lost"]

# What an estimate would say where a belief says so.
STATUS_OF_BELIEF: dict[BeliefStatus, Status] = {
    "ok": "ok",
    "ambiguous": "ambiguous",
    "slipping": "ok",
    "no_contact": "no_solution",
    "lost": "no_solution",
}
