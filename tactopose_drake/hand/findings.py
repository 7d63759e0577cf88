"""What a check finds."""

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "note", "fault"]


@dataclass(frozen=True)
class Finding:
    """One line of the check.

    Attributes:
        part: of the hand, in a word or two.
        text: what was found, a sentence without its full stop.
        verdict: "fault" where the hand cannot be used as it is, "note" where it can but one should know.
        entry: what the part's place in the hand's YAML file should say instead; empty where there is nothing better.
    """

    part: str
    text: str
    verdict: Verdict = "ok"
    entry: str = ""


def fault(part: str, error: Exception) -> Finding:
    """An error as what was found."""
    return Finding(part, " ".join(str(error).split()).removesuffix("."), "fault")
