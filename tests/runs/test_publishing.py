"""What goes out to other processes, and of which time it says it is."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform

from tactopose_drake.estimation.results import PoseEstimate, PoseHypothesis
from tactopose_drake.runs import publishing
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.scenario import Scenario


def test_a_pose_is_dated_when_it_was_touched_also_where_it_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Any] = []
    out = SimpleNamespace(max_modes=4, send=sent.append)
    monkeypatch.setattr(publishing, "open_publisher", lambda scenario: out)
    said: dict[str, Any] = {}
    ports: Any = SimpleNamespace(
        HasOutputPort=said.__contains__, GetOutputPort=lambda name: SimpleNamespace(Eval=lambda context: said[name])
    )
    view = RunView(ports, SimpleNamespace(get_time=lambda: said["time"]))
    publish = publishing.publishing(Scenario(), lambda view: None)
    pose = PoseHypothesis(RigidTransform(), 1.0, 1.0, 1e-6 * np.eye(6), np.zeros((0, 6)))
    found = PoseEstimate((pose,), "ok", 0.01)
    for time, status, estimate in (
        (0.1, "held: no estimate yet", None),
        (0.2, "ok", found),
        (0.3, "held: 0 fingers touch", found),
        (5.0, "held: 0 fingers touch", found),
        (5.1, "ambiguous", found),
        (5.13, "ambiguous", found),  # the end of a run
    ):
        said |= {"time": time, "status": status, "hypotheses": estimate}
        publish(view)
    assert [message.utime for message in sent] == [0, 100_000, 100_000, 100_000, 5_000_000, 5_100_000]
    assert [len(message.probability) for message in sent] == [0, 1, 1, 1, 1, 1]
