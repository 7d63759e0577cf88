import multiprocessing
import os
import threading

import numpy as np
import pytest

from tactopose_drake.core.objectives.surface_contact import SurfaceContact
from tactopose_drake.core.poses import retract
from tactopose_drake.core.searches.levenberg_marquardt import LevenbergMarquardt
from tactopose_drake.core.synthetic_touch import touch_surface
from tactopose_drake.core.two_cores import in_two_parts
from tests.core.searches.problems import make_blob


def test_each_part_is_done_once() -> None:
    done: list[int] = []
    for _ in range(50):
        in_two_parts(done.append)
    assert sorted(done) == [0] * 50 + [1] * 50


@pytest.mark.parametrize("failing", [0, 1])
def test_what_goes_wrong_in_either_part_is_said(failing: int) -> None:
    def work(part: int) -> None:
        if part == failing:
            raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        in_two_parts(work)


def test_where_the_helper_is_busy_the_caller_does_both() -> None:
    busy, release, done = threading.Event(), threading.Event(), []

    def block(part: int) -> None:
        if threading.current_thread().name.startswith("second-core"):
            busy.set()
            release.wait(10.0)
        elif os.cpu_count() != 1:
            busy.wait(10.0)

    blocking = threading.Thread(target=in_two_parts, args=(block,))
    blocking.start()
    try:
        busy.wait(10.0) if os.cpu_count() != 1 else None
        in_two_parts(lambda part: done.append((part, threading.current_thread().name)))
    finally:
        release.set()
        blocking.join()
    assert [part for part, _ in done] == [0, 1]
    assert {name for _, name in done} == {threading.current_thread().name}


def test_a_forked_child_does_its_work() -> None:
    in_two_parts(lambda part: None)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(_sum_of_parts).get(timeout=30.0) == 1


def _sum_of_parts() -> int:
    parts: list[int] = []
    in_two_parts(parts.append)
    return sum(parts)


def test_one_core_finds_what_two_find(monkeypatch: pytest.MonkeyPatch) -> None:
    blob, generator = make_blob(), np.random.default_rng(0)
    touch = SurfaceContact(blob.grid, touch_surface(blob, np.eye(3, 4), 5, generator))
    X_PO = retract(np.eye(3, 4), 0.02 * generator.normal(size=(100, 6)))
    two = LevenbergMarquardt(max_iterations=8).refine(touch, X_PO)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    one = LevenbergMarquardt(max_iterations=8).refine(touch, X_PO)
    np.testing.assert_array_equal(one.X_PO, two.X_PO)
