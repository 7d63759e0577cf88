"""When a simulated grasp counts as stable, and why not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from tactopose_drake.runs.contact_truth import ContactTruth, PartContact
from tactopose_drake.runs.grasp_watch import GraspWatch
from tactopose_drake.station.scenario import GraspCheck

CHECK = GraspCheck()


def truth(tips: int, force: float = 2.0, others: tuple[str, ...] = ()) -> ContactTruth:
    """So many fingertips that carry, and one that hardly touches."""
    forces = {f"finger {k}": force for k in range(tips)} | {"brushes": 0.5 * CHECK.least_force}
    n = np.array([0.0, 0.6, 0.8])
    return ContactTruth({name: PartContact(np.zeros(3), n, f * n, 1e-5) for name, f in forces.items()}, {}, others)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({}, ""),
        ({"release_time": None}, "the fingers did not close in time"),
        ({"slip": 1.01 * CHECK.most_slip}, "the object slipped by"),
        ({"truth": truth(CHECK.least_fingers - 1)}, f"only {CHECK.least_fingers - 1} fingertips carry the object"),
        ({"truth": truth(5, 0.9 * CHECK.least_force)}, "only 0 fingertips carry the object"),
        ({"truth": truth(5, others=("palm", "link"))}, "the object also touches palm, link"),
        ({"truth": truth(5, others=("palm",)), "plan": None}, ""),  # a grip takes what comes
        ({"speed": 1.01 * CHECK.most_speed}, "the object still moves at"),
        ({"spin": 1.01 * CHECK.most_angular_speed}, "the object still moves at"),
    ],
)
def test_what_is_wrong_with_a_grasp(change: dict, reason: str) -> None:
    told = {"release_time": 1.0, "slip": 0.9 * CHECK.most_slip, "truth": truth(CHECK.least_fingers), "plan": "a plan"}
    told |= {"speed": 0.9 * CHECK.most_speed, "spin": 0.9 * CHECK.most_angular_speed} | change
    hand = SimpleNamespace(sensor_frames=dict.fromkeys("abcde"), pad_frames={})
    station = SimpleNamespace(scenario=SimpleNamespace(check=CHECK), hand=hand, plan=told["plan"])
    watch = GraspWatch(station)  # type: ignore[arg-type]
    watch.release_time = told["release_time"]
    watch.slip = lambda context: told["slip"]  # type: ignore[method-assign]
    watch.motion = lambda context: (told["speed"], told["spin"])  # type: ignore[method-assign]
    fault = watch._fault(None, told["truth"])  # type: ignore[arg-type]
    assert fault.startswith(reason)
    assert bool(fault) == bool(reason)


def test_the_object_s_slip_and_turn_count_from_its_release() -> None:
    """Here a context is the object's pose, and whether it is locked."""
    station = SimpleNamespace(
        plant=SimpleNamespace(GetMyContextFromRoot=lambda context: context),
        object_joint=SimpleNamespace(is_locked=lambda context: context.locked),
        object_pose=lambda context: context.X_PO,
    )
    watch = GraspWatch(station)  # type: ignore[arg-type]

    def moment(z: float, turn: float, locked: bool = False) -> Any:
        X_PO = RigidTransform(RotationMatrix.MakeXRotation(0.3) @ RotationMatrix.MakeZRotation(turn), [0.0, 0.1, z])
        return SimpleNamespace(X_PO=X_PO, locked=locked, get_time=lambda: 1.0)

    held = moment(0.5, 1.0, locked=True)
    watch.see(held)
    assert (watch.slip(held), watch.turn(held)) == (0.0, 0.0)
    watch.see(moment(0.02, 0.1))
    watch.see(moment(0.04, 0.2))
    later = moment(0.05, 0.1 - 2.5)
    assert (watch.slip(later), watch.turn(later)) == pytest.approx((0.03, 2.5))
