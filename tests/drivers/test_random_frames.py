"""A small part of what `random_frames` does on its own with ten million frames."""

import pytest

from tactopose_drake.drivers import netcanoem_protocol
from tests.drivers.random_frames import shake


def test_random_frames_raise_nothing_else_and_are_not_believed() -> None:
    assert 2_000 < shake(20_000, seed=1) < 10_000


def test_a_decoder_that_accepts_too_much_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(netcanoem_protocol, "CALIBRATIONS", 256)
    with pytest.raises(AssertionError, match="calibration: accepted"):
        shake(20_000, seed=1)
