"""Which joints follow others by a model's own account."""

from pathlib import Path

import pytest

from tactopose_drake.hand.mimics import Mimic, read_mimics

SDF = """<sdf version="1.11"><model name="m">
  <joint name="first" type="revolute"/>
  <joint name="second" type="revolute"><axis><mimic joint="first">
    <multiplier>2</multiplier><offset>0.1</offset><reference>0.3</reference>
  </mimic></axis></joint>
</model></sdf>"""
DRAKE_SDF = """<sdf version="1.11" xmlns:drake="https://drake.mit.edu"><model name="m">
  <joint name="first" type="revolute"/>
  <joint name="second" type="revolute"><drake:mimic joint="first" multiplier="2"/></joint>
</model></sdf>"""
URDF = """<robot name="m"><joint name="first" type="revolute"/>
  <joint name="second" type="revolute"><mimic joint="first" multiplier="-0.5" offset="0.2"/></joint>
  <joint name="third" type="revolute"><mimic joint="second"/></joint>
</robot>"""


@pytest.mark.parametrize(
    ("text", "mimics"),
    [
        # SDFormat: multiplier (q_first - reference) + offset. Drake ignores its entries.
        (SDF, (Mimic("second", "first", 2.0, pytest.approx(0.1 - 2.0 * 0.3), is_obeyed=False),)),
        (DRAKE_SDF, (Mimic("second", "first", 2.0, 0.0),)),
        (URDF, (Mimic("second", "first", -0.5, 0.2), Mimic("third", "first", -0.5, 0.2))),
        ("<mujoco/>", None),
    ],
    ids=["sdf", "drake_sdf", "urdf", "other"],
)
def test_what_follows_is_read_as_the_format_means_it(
    tmp_path: Path, text: str, mimics: tuple[Mimic, ...] | None
) -> None:
    path = tmp_path / "model"
    path.write_text(text)
    assert read_mimics(path) == mimics
