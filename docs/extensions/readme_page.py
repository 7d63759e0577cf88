"""Makes the page `start` from the README, whose links lead into the checkout, and only some into the site."""

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

README = Path(__file__).parents[2] / "README.md"


def to_page(text: str) -> str:
    """The README as a page in docs/: what lies there is found from there, other files are named and not linked."""

    def name(link: re.Match[str]) -> str:
        return f"`{link[2]}`" if link[1] == link[2] else f"{link[1]} (`{link[2]}`)"

    text = re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|docs/)([^)]+)\)", name, text)
    return text.replace("](docs/", "](")


def read(app: Sphinx, name: str, source: list[str]) -> None:
    """Gives the page its text when Sphinx reads it."""
    if name == "start":
        app.env.note_dependency(str(README))
        source[0] = to_page(README.read_text(encoding="utf-8"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Tells Sphinx of the page."""
    app.connect("source-read", read)
    return {"parallel_read_safe": True}
