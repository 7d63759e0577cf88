"""The real-time factor of the simulated station while the hand holds an object: simulated over processor seconds.

`pytest -n 0 -s tests/benchmarks/test_station.py` prints it; --benchmark-json keeps it as extra_info. With the simulated
hand and its senses alone, with the estimate at 10 Hz too, with the belief at 100 Hz in its place, and with both: where
the time goes is the difference.
"""

import time
from typing import Any

import pytest

from tactopose_drake.runs.grasp_simulation import simulate_grasp
from tactopose_drake.station.scenario import Scenario
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tests.benchmarks.support import load

SECONDS = 0.5


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("name", ["hand and senses", "estimate", "belief", "estimate and belief"])
def test_real_time_factor(benchmark: Any, name: str) -> None:
    scenario = Scenario(object="mug", tracking=PoseTrackingParams() if "belief" in name else None)
    if "estimate" not in name:
        scenario.estimation.estimator.period = 1e3
    grasp = simulate_grasp(scenario)
    assert grasp.stable, grasp.reason
    hold = load("slip_in_station").hold
    benchmark.pedantic(hold, (grasp, SECONDS), rounds=4, warmup_rounds=1)
    factor = SECONDS / benchmark.stats.stats.median
    benchmark.extra_info["real_time_factor"] = factor
    print(f"\n{name}: real-time factor {factor:.2f}")  # noqa: T201
