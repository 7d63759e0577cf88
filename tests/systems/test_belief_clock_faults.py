"""What the belief says while the clock stands still or goes back."""

import pytest

from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.systems.pose_belief_estimator import PoseBeliefEstimator, PoseBeliefParams
from tests.core.tracking.boxes import make_box
from tests.systems.belief_runs import PERIOD, Run, begun, still, touched


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return make_box()


def test_a_clock_that_stands_still_or_goes_back_ends_nothing(box: ObjectModel) -> None:
    run = Run(PoseBeliefEstimator(box), vision=begun(lambda time: None), **touched(still))
    assert run.until(0.3).status == "ok"
    run.set_back(0.3)
    assert run.read("belief").time == 0.3
    assert run.read("status") == "ok"
    run.set_back(0.0)
    assert run.read("belief").time == 0.0
    assert run.read("status").endswith("begun anew: the clock went back from 0.3 s")
    run.instants.clear()
    assert run.until(0.2).status == "ok"
    run.assert_never_a_silent_guess(still)


@pytest.mark.parametrize("latency", [0.0, 0.025])
def test_what_was_shown_before_the_clock_went_back_is_not_shown_after(box: ObjectModel, latency: float) -> None:
    system = PoseBeliefEstimator(box, PoseBeliefParams(latency=latency))
    run = Run(system, vision=begun(lambda time: None), **touched(still))
    run.until(0.3)
    run.set_back(0.0)
    for _ in range(5):
        assert run.read("belief").time <= run.context.get_time()
        run.simulator.AdvanceTo(run.context.get_time() + PERIOD)
