"""What the study of declared errors makes wrong, and tells; the grasps are a simulation's, run by hand."""

import dataclasses
from pathlib import Path

import pytest

from tactopose_drake.hand import load_hand_config
from tests.examples.scripts import load_script

study = load_script("declared_errors")


@pytest.mark.parametrize("name", list(study.ROWS))
def test_what_errs_is_told(name: str, tmp_path: Path) -> None:
    row = study.ROWS[name]
    scenario = study.make_scenario(row, "mug", 3, tmp_path)
    scenario.validate()
    told, errors = load_hand_config(scenario.hand).uncertainty, scenario.errors
    assert told == row.uncertainty()
    assert scenario.scale_sigma == pytest.approx(errors.object_scale - 1.0)
    assert errors.drawn
    assert not errors.tared
    for finger in errors.fingers.values():
        assert finger.radius in (None, told.fingertip_radius)
        assert {abs(bias) for bias in finger.sensor_force} <= {told.sensor_force}
        assert {abs(bias) for bias in finger.sensor_moment} <= {told.sensor_moment}
    assert {abs(offset) for offset in errors.joint_offsets_deg.values()} <= {told.encoder_offset_deg}
    again = study.make_scenario(row, "mug", 3, tmp_path).errors
    assert dataclasses.asdict(again) == dataclasses.asdict(errors)


def test_a_line_counts() -> None:
    good, bad = study.Trial(True, True, False, 0.001, 0.02), study.Trial(False, True, True, 0.003, 0.04)
    line = study.line("a row", [good, bad], 1)
    assert "2 grasps, 1 did not hold the object; truth in the 95 % set  50.0%" in line
    assert "both errors fell 100.0%, said held  50.0%; medians 2.0 mm, 1.7 deg" in line
    assert study.line("a row", [], 3).endswith("none of 3 grasps held the object")
