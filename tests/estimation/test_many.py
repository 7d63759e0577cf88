"""Many touches in one call: the same bits as one by one, wherever the work is done."""

import dataclasses
import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.errors import InvalidInputError, TooFewContactsError
from tactopose_drake.estimation import identification, many
from tests.core.meshes import create

COUNT = 12


@pytest.fixture(scope="module")
def box() -> tp.ObjectModel:
    return tp.ObjectModel.from_mesh(create.box([0.05, 0.08, 0.12]), max_grid_bytes=16 * 100_000)


def touches(models: list[tp.ObjectModel]) -> tuple[list[tp.Contacts], list[tp.PosePrior | None]]:
    contacts, priors = [], []
    for i, model in enumerate(models):
        generator = np.random.default_rng(i)
        X_PO = make_poses(random_rotations(generator, 1), generator.normal(scale=0.05, size=(1, 3)))[0]
        contacts.append(touch_surface(model, X_PO, 4, generator))
        priors.append(tp.PosePrior(X_PO) if i % 3 else None)
    return contacts, priors


def bits(estimate: tp.PoseEstimate) -> tuple[str, bytes]:
    parts = [np.float64(estimate.log_evidence)]
    for one in estimate.hypotheses:
        parts += [one.X_PO.GetAsMatrix34(), one.covariance, one.free_directions, np.float64(one.probability)]
    return estimate.status, b"".join(np.asarray(part).tobytes() for part in parts)


@pytest.fixture(params=["threads", "two threads", "process"])
def executor(request: pytest.FixtureRequest) -> Iterator[Executor | None]:
    if request.param == "threads":
        yield None
        return
    pool = ThreadPoolExecutor(2) if request.param == "two threads" else ProcessPoolExecutor(1, get_context("spawn"))
    with pool:
        yield pool


def test_the_same_bits_as_one_by_one(box: tp.ObjectModel, blob: tp.ObjectModel, executor: Executor | None) -> None:
    models = [box if i % 2 else blob for i in range(COUNT)]
    contacts, priors = touches(models)
    told: list[tuple[int, int]] = []
    found = tp.estimate_poses(
        models,
        contacts,
        priors=priors,
        seed=list(range(COUNT)),
        executor=executor,
        on_progress=lambda done, total: told.append((done, total)),
        max_hypotheses=16,
    )
    for i, estimate in enumerate(found):
        alone = tp.estimate_pose(models[i], contacts[i], prior=priors[i], seed=i, max_hypotheses=16)
        assert bits(estimate) == bits(alone)
    assert len(found) == COUNT
    assert told[-1] == (COUNT, COUNT)
    assert told == sorted(told)


def test_one_model_and_one_prior_are_those_of_all_touches(box: tp.ObjectModel) -> None:
    contacts, _ = touches([box] * 3)
    prior = tp.PosePrior(np.eye(4), sigma_translation=0.1, sigma_rotation=math.pi)
    found = tp.estimate_poses(box, contacts, priors=prior)
    assert [bits(one) for one in found] == [bits(tp.estimate_pose(box, one, prior=prior)) for one in contacts]
    assert tp.estimate_poses(box, []) == []


def test_a_fault_names_the_touch(box: tp.ObjectModel) -> None:
    contacts, _ = touches([box] * 3)
    with pytest.raises(TooFewContactsError) as caught:
        tp.estimate_poses(box, [*contacts, tp.Contacts.empty()])
    assert caught.value.__notes__ == ["The error is of contacts[3]."]


def test_an_executor_that_is_shut_down_is_refused(box: tp.ObjectModel) -> None:
    contacts, _ = touches([box] * 2)
    with ThreadPoolExecutor(1) as executor:
        pass
    with pytest.raises(InvalidInputError, match=r"^executor must be open, but takes no work"):
        tp.estimate_poses(box, contacts, executor=executor)


class Fallen(Executor):
    """Takes work and does not do it."""

    def __init__(self, fall: Callable[[Future[Any]], object]) -> None:
        self._fall = fall

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        """A future that falls."""
        future: Future[Any] = Future()
        self._fall(future)
        return future


@pytest.mark.parametrize(
    ("fall", "message"),
    [
        (lambda future: future.cancel(), r"^executor must stay open until the work is done, not be shut down before"),
        (
            lambda future: future.set_exception(BrokenProcessPool("killed")),
            r"^executor must keep its workers until the work is done, but has lost them .*killed",
        ),
    ],
    ids=["shut down", "dead workers"],
)
def test_an_executor_that_ends_amid_the_work_is_named(
    box: tp.ObjectModel,
    fall: Callable[[Future[Any]], object],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    contacts, _ = touches([box] * 3)
    create.box([0.05, 0.08, 0.12]).export(tmp_path / "box.stl")
    with pytest.raises(InvalidInputError, match=message):
        tp.estimate_poses(box, contacts, executor=Fallen(fall))
    with pytest.raises(InvalidInputError, match=message):
        tp.identify([box], contacts[0], executor=Fallen(fall))
    monkeypatch.setenv("TACTOPOSE_CACHE_DIR", str(tmp_path / "cache"))
    with pytest.raises(InvalidInputError, match=message):
        tp.ObjectLibrary.open(tmp_path, executor=Fallen(fall))


def test_an_executor_that_is_shut_down_amid_the_work_ends_it(
    box: tp.ObjectModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts, _ = touches([box])
    executor, busy = ThreadPoolExecutor(1), threading.Event()
    executor.submit(busy.wait)

    def submit(*arguments: Any) -> Future[Any]:
        future = ThreadPoolExecutor.submit(executor, *arguments)
        executor.shutdown(wait=False, cancel_futures=True)
        return future

    monkeypatch.setattr(executor, "submit", submit)
    try:
        with pytest.raises(
            InvalidInputError, match="executor must stay open until the work is done, not be shut down before"
        ):
            tp.estimate_poses(box, contacts, executor=executor)
    finally:
        busy.set()


def test_kernels_are_ready_before_threads_begin(box: tp.ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []
    monkeypatch.setattr(many, "make_kernels_ready", lambda: events.append("kernels"))
    monkeypatch.setattr(many, "estimate_pose", lambda *_, **__: events.append("estimate"))
    contacts, _ = touches([box] * 3)
    many.estimate_poses(box, contacts)
    assert events == ["kernels", "estimate", "estimate", "estimate"]


def test_kernels_are_ready_before_objects_are_told_apart_by_threads(
    box: tp.ObjectModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[str] = []
    monkeypatch.setattr(identification, "make_kernels_ready", lambda: events.append("kernels"))
    contacts, _ = touches([box])
    with ThreadPoolExecutor(2) as executor:
        monkeypatch.setattr(executor, "map", lambda *arguments: events.append("map") or map(*arguments))
        tp.identify([box], contacts[0], executor=executor)
    assert events[:2] == ["kernels", "map"]


def test_numbers_that_do_not_agree_are_refused(box: tp.ObjectModel) -> None:
    contacts, priors = touches([box] * 3)
    with pytest.raises(
        InvalidInputError, match="contacts must be a sequence of Contacts, one for each touch, not a single one"
    ):
        tp.estimate_poses(box, contacts[0])
    with pytest.raises(InvalidInputError, match=r"models must be one .*, or one for each of 3 touches, not 2 of them"):
        tp.estimate_poses([box] * 2, contacts)
    with pytest.raises(InvalidInputError, match=r"prior must be given as `priors=`"):
        tp.estimate_poses(box, [], prior=None)
    with pytest.raises(InvalidInputError, match=r"priors must be one PosePrior, or .*, not 2 of them"):
        tp.estimate_poses(box, contacts, priors=priors[:2])
    with pytest.raises(InvalidInputError, match=r"seed\[1\] must be an integer >= 0, not '1'"):
        tp.estimate_poses(box, contacts, seed=[0, "1", 2])  # type: ignore[list-item]


def test_what_is_no_touches_and_no_executor_is_named(box: tp.ObjectModel) -> None:
    contacts, _ = touches([box] * 2)
    with pytest.raises(InvalidInputError, match=r"^contacts must be an Iterable, not None"):
        tp.estimate_poses(box, None)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=r"^executor must be an Executor, not an int"):
        tp.estimate_poses(box, contacts, executor=3)  # type: ignore[arg-type]


def test_numpys_integers_are_seeds(box: tp.ObjectModel) -> None:
    contacts, _ = touches([box] * 2)
    (by_numpy, _), (plain, _) = (tp.estimate_poses(box, contacts, seed=seed) for seed in (np.int64(7), 7))
    assert by_numpy == dataclasses.replace(plain, duration=by_numpy.duration)


def test_what_cannot_be_is_named_before_any_work(box: tp.ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    contacts, _ = touches([box] * 3)
    forced = [tp.Contacts(each.p_PC, each.n_PC, each.n_PC) for each in contacts]
    monkeypatch.setattr(many, "make_kernels_ready", lambda: pytest.fail("work has begun"))
    for arguments, message in (
        ({"contacts": np.array(0.5)}, r"contacts must be a sequence of Contacts, not array\(0.5\)"),
        ({"contacts": ""}, "contacts must be a sequence of Contacts, not ''"),
        ({"contacts": {}}, "contacts must be a sequence of Contacts, not {}"),
        ({"contacts": set()}, r"contacts must be a sequence of Contacts, not set\(\)"),
        ({"contacts": [*contacts, "touch"]}, r"contacts\[3\] must be a Contacts, not a str"),
        ({"models": None}, "models must be one ObjectModel, or .*, not None"),
        ({"models": [box, None, box]}, r"models\[1\] must be an ObjectModel, not None"),
        ({"seed": None}, "seed must be one integer, or one for each of 3 touches, not None"),
        ({"seed": np.arange(2)}, "seed must be one integer, or .*, not 2 of them"),
        ({"seed": [0, 1, "2"]}, r"seed\[2\] must be an integer >= 0, not '2'"),
        ({"seed": -1}, r"seed\[0\] must be an integer >= 0, not -1"),
        ({"priors": [None, 0.1, None]}, r"priors\[1\] must be a PosePrior, not a float"),
        ({"on_progress": 3}, "on_progress must be a Callable, not an int"),
        ({"contacts": [*contacts[:2], contacts[2][:0]]}, "contacts must be at least 1 if no patch is felt, not 0"),
        ({"method": "guess"}, "method must be one of .*, not 'guess'"),
        ({"method": "gradient_descent"}, "prior must be a PosePrior for the method 'gradient_descent', not None"),
        ({"patches": [()] * 3}, r"patches\[0\] must be a Patch, not a tuple"),
        ({"max_hypotheses": 0}, "max_hypotheses must be an integer >= 1, not 0"),
        ({"friction": 0.5}, "contacts must have forces f_PC for the friction, not None"),
        (
            {"contacts": forced, "balance": tp.ForceBalance([0.0, 0.0, -9.81])},
            "model must have a mass for the balance, but that of .* is not known",
        ),
    ):
        with pytest.raises(InvalidInputError, match=message):
            tp.estimate_poses(**({"models": box, "contacts": contacts} | arguments))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"estimate_pose\(\) got an unexpected keyword argument 'methods'"):
        tp.estimate_poses(box, contacts, methods="direct")


def test_seeds_may_be_an_array(box: tp.ObjectModel) -> None:
    contacts, _ = touches([box] * 2)
    found = tp.estimate_poses(box, contacts, seed=np.array([3, 4]))
    assert [bits(one) for one in found] == [bits(one) for one in tp.estimate_poses(box, contacts, seed=[3, 4])]
