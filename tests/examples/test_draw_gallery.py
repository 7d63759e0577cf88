import re
from pathlib import Path

import numpy as np
from matplotlib.image import imread

from tactopose_drake.resources import resource_root
from tests.examples.scripts import load_script

DOCS = resource_root() / "docs"


def test_the_gallery_shows_what_its_code_makes(tmp_path: Path) -> None:
    load_script("draw_gallery.py").main([str(tmp_path)])
    shown = re.findall(r"!\[[^\]]+\]\(pictures/(\w+\.png)\)", (DOCS / "gallery.md").read_text())
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(shown)
    for name in shown:
        drawn, stored = (imread(folder / name)[..., :3] for folder in (tmp_path, DOCS / "pictures"))
        assert drawn.shape == stored.shape
        # Other processors round otherwise, which moves an edge by a pixel here and there.
        assert np.mean(np.abs(drawn - stored).max(axis=2) > 40 / 255) < 0.01, name
