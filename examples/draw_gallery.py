"""Makes the pictures of the documentation's gallery, docs/gallery.md, by the code that stands in it."""

import re
import sys
from contextlib import chdir
from pathlib import Path

from tactopose_drake.resources import resource_root


def main(arguments: list[str]) -> None:
    """Writes the pictures into docs/pictures, or the folder that is named."""
    docs = resource_root() / "docs"
    folder = Path(arguments[0]) if arguments else docs / "pictures"
    blocks = re.findall(r"^```python\n(.*?)^```$", (docs / "gallery.md").read_text(encoding="utf-8"), re.M | re.S)
    folder.mkdir(parents=True, exist_ok=True)
    with chdir(folder):
        exec("\n".join(blocks), {})


if __name__ == "__main__":
    main(sys.argv[1:])
