import re
from pathlib import Path

from matplotlib.image import imread

from tactopose_drake.resources import resource_root
from tests.examples.scripts import load_script

DOCS = resource_root() / "docs"


def test_the_gallery_shows_what_its_code_makes(tmp_path: Path) -> None:
    load_script("draw_gallery.py").main([str(tmp_path)])
    shown = re.findall(r"!\[[^\]]+\]\(pictures/(\w+\.png)\)", (DOCS / "gallery.md").read_text())
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(shown)
    for name in shown:
        # Whether there is a panel of the prior, and how many lines the legend has, says what is drawn.
        assert imread(tmp_path / name).shape == imread(DOCS / "pictures" / name).shape
