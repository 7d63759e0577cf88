"""The findings of a check of a hand's files, and suggested entries."""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from tactopose_drake.hand.hand_config import Coupling

Verdict = Literal["ok", "note", "fault"]

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")
_WORDS = {"yes", "no", "on", "off", "true", "false", "null"}  # words that YAML does not read as strings


@dataclass(frozen=True)
class Entry:
    """A suggested entry of a finger in the hand's file.

    Attributes:
        finger: the finger's name.
        key: a key of the finger, such as "joints".
        value: names, couplings, one name, or for the key "surface" its YAML.
    """

    finger: str
    key: str
    value: tuple[str, ...] | tuple[Coupling, ...] | str

    @property
    def yaml(self) -> str:
        """The entry's lines."""
        if isinstance(self.value, str):
            return f"{self.key}: {self.value if self.key == 'surface' else _name(self.value)}"
        names = [_name(value) for value in self.value if isinstance(value, str)]
        couplings = [f"\n- {_coupling(value)}" for value in self.value if isinstance(value, Coupling)]
        return f"{self.key}:{''.join(couplings)}" if couplings else f"{self.key}: [{', '.join(names)}]"


@dataclass(frozen=True)
class Finding:
    """One line of the check.

    Attributes:
        part: the part of the hand, in a word or two.
        text: what was found, a sentence without its full stop.
        verdict: "fault" if the hand cannot be used as it is, "note" if it can, but the user should know.
        entries: suggested entries for the hand's file; empty if there are none.
    """

    part: str
    text: str
    verdict: Verdict = "ok"
    entries: tuple[Entry, ...] = ()


def fault(part: str, error: Exception) -> Finding:
    """Converts an error to a finding, without the part's name in the text."""
    kind, _, name = part.partition(" ")
    text = " ".join(str(error).split()).removesuffix(".").removeprefix(f"{kind} {name!r}: ")
    return Finding(part, text, "fault")


def fingers_yaml(entries: Iterable[Entry]) -> str:
    """The entries as lines of the hand's file, finger by finger."""
    lines: list[str] = []
    fingers: dict[str, list[Entry]] = {}
    for entry in entries:
        fingers.setdefault(entry.finger, []).append(entry)
    for finger, its in fingers.items():
        lines.append(f"- name: {_name(finger)}")
        lines += ["  " + line for entry in its for line in entry.yaml.splitlines()]
    return "\n".join(lines)


def _name(name: str) -> str:
    return name if _PLAIN.fullmatch(name) and name.lower() not in _WORDS else json.dumps(name)


def _coupling(coupling: Coupling) -> str:
    offset = f", offset: {coupling.offset:g}" if coupling.offset else ""
    names = f"joint: {_name(coupling.joint)}, follows: {_name(coupling.follows)}"
    return f"{{{names}, ratio: {coupling.ratio:g}{offset}}}"
