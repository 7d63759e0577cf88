"""A few trials of what the whole study counts."""

from tests.examples.scripts import load_script


def test_wrong_vision_and_objects_that_were_moved_are_withstood() -> None:
    study = load_script("belief_faults.py")
    assert study.withstands_vision(66)
    assert study.finds_again(1).right
