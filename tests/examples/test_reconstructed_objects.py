import functools
import re
from pathlib import Path

import pytest

from tactopose_drake.core.vision import DepthCameraModel, FusionParams, reconstruct
from tests.examples.scripts import load_script


def test_views_from_around_leave_less_unseen_and_touch_corrects_the_guess_on_their_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    script = load_script("reconstructed_objects.py")
    monkeypatch.setattr(script, "TOUCHES", 2)
    monkeypatch.setattr(script, "CAMERA", DepthCameraModel(width=160, height=120, focal_length=144.0))
    monkeypatch.setattr(script, "reconstruct", functools.partial(reconstruct, params=FusionParams(spacing=0.003)))
    monkeypatch.setattr(script, "see", functools.cache(script.see))  # The picture is of what was seen before.
    out = tmp_path / "new"
    arguments = ["--objects", "spray_bottle", "--trials", "1", "--out", str(out)]
    monkeypatch.setattr("sys.argv", ["reconstructed_objects.py", *arguments])
    script.main()
    table = (out / "reconstructed_objects.md").read_text()
    assert table in capsys.readouterr().out
    rows = re.findall(
        r"^\| spray_bottle, (.+?) \| 2 \| ([\d.]+) \(([\d.]+)\) \| ([\d.]+) \([\d.]+\) \| (\d+) \|", table, re.MULTILINE
    )
    around, one_side = ({"views": name, "off": float(off), "unseen": int(share)} for name, off, _, _, share in rows)
    assert (around["views"], one_side["views"]) == ("from around", "from one side")
    assert around["off"] < 3.0  # mm, where it was seen
    assert around["unseen"] < one_side["unseen"]
    inside = re.findall(r"in the set of 95 % in (\d) of 2", table)
    assert len(inside) == 2
    assert (out / "reconstructed_objects.png").stat().st_size > 1e4
