"""Docstrings as their readers mean them: a bar is a bar, and an array of numbers has a short name."""

import re
from typing import Any

from sphinx.application import Sphinx

ARRAY = re.compile(
    r"~?(numpy\.)?ndarray\[tuple\[(~?typing\.)?Any, \.\.\.\], ~?(numpy\.)?dtype\[~?(numpy\.)?float64\]\]"
)


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
    """Tells Sphinx of both rules."""
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("autodoc-process-signature", shorten)
    return {"parallel_read_safe": True}
