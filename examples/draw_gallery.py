"""Makes the pictures of the documentation's gallery with the code in docs/gallery.md."""

import argparse
import re
from contextlib import chdir
from pathlib import Path

from tactopose_drake.resources import resource_root


def main(arguments: list[str] | None = None) -> None:
    """Writes the pictures; the arguments are by default those of the command line."""
    docs = resource_root() / "docs"
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=docs / "pictures", help="docs/pictures by default")
    folder = parser.parse_args(arguments).folder
    blocks = re.findall(r"^```python\n(.*?)^```$", (docs / "gallery.md").read_text(encoding="utf-8"), re.M | re.S)
    folder.mkdir(parents=True, exist_ok=True)
    with chdir(folder):
        exec("\n".join(blocks), {})


if __name__ == "__main__":
    main()
