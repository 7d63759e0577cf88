"""Docstrings as their readers mean them: a bar is a bar, a colon a colon, and an array of numbers has a short name."""

import re
from typing import Any

from sphinx.application import Sphinx

ARRAY = re.compile(
    r"~?(numpy\.)?ndarray\[tuple\[(~?typing\.)?Any, \.\.\.\], ~?(numpy\.)?dtype\[~?(numpy\.)?float64\]\]"
)


_COLON = "\ue000"  # stands for a colon while Napoleon looks


def hide_colon(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Hides the colons of a property's first line, which Napoleon takes for the end of its type."""
    if what in ("property", "attribute", "data") and lines:
        lines[0] = lines[0].replace(":", _COLON)


def show_colon(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Shows them again."""
    lines[:] = [line.replace(_COLON, ":") for line in lines]


def escape_bars(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Escapes the bars (the length of a vector) outside of literals, which reST takes for a substitution."""
    for i, line in enumerate(lines):
        parts = re.split(r"(``.*?``|`.*?`)", line)
        lines[i] = "".join(part if part.startswith("`") else part.replace("|", r"\|") for part in parts)


def shorten(
    app: Sphinx, what: str, name: str, obj: object, options: object, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Writes `FloatArray` for what NumPy's own alias spells out."""
    return tuple(text and ARRAY.sub("FloatArray", text) for text in (signature, returns))


def setup(app: Sphinx) -> dict[str, Any]:
    """Tells Sphinx of the rules; Napoleon's is of priority 500."""
    app.connect("autodoc-process-docstring", hide_colon, priority=400)
    app.connect("autodoc-process-docstring", show_colon, priority=600)
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("autodoc-process-signature", shorten)
    return {"parallel_read_safe": True}
