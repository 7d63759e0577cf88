"""How soon there is a first estimate, and how many there are in a second.

In processes of their own: the command line on a known object; a known object's model, and its first estimates beside
later ones; and all that estimates, tracking and the contact solver compile, from nothing. In this one: many touches one
by one, and at a time.
"""

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.resources import model_path

MUG = model_path("objects", "mug.obj")
CONTACTS = """
contacts:
- {position: [0.031, 0.002, 0.094], normal: [0.0, -1.0, 0.0]}
- {position: [0.008, 0.061, 0.090], normal: [0.0, 1.0, 0.0]}
- {position: [0.052, 0.030, 0.101], normal: [1.0, 0.0, 0.0]}
"""
START = "from tactopose_drake.cli.entry import start; start()"
FIRST = """
import sys, time
import tactopose_drake as tp
from tests.benchmarks.test_readiness import touches

def clock(call):
    begin = time.perf_counter()
    result = call()
    return result, 1e3 * (time.perf_counter() - begin)

tp.estimate_pose
for name in sys.argv[1:]:
    model, ready = clock(lambda: tp.ObjectModel.from_mesh(name))
    contacts = touches(model, 9)
    times = [clock(lambda: tp.estimate_pose(model, one))[1] for one in contacts]
    print(ready, times[0], sorted(times[1:])[4])
"""
ALL = "from tests.first_use import CALLS\nfor name in {calls!r}: CALLS[name](0)"
CALLS = ("with_prior", "without_prior", "tracked", "solved", "described")


def touches(model: tp.ObjectModel, count: int) -> list[tp.Contacts]:
    generator = np.random.default_rng(0)
    X_PO = make_poses(random_rotations(generator, count), generator.normal(scale=0.05, size=(count, 3)))
    return [touch_surface(model, X, 5, generator) for X in X_PO]


def run(code: str, *arguments: object, **environment: str) -> str:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=True)
    return done.stdout


def show(text: str) -> None:
    print(f"\n{text}")  # noqa: T201


def test_command_line(benchmark: Any, tmp_path: Path) -> None:
    (tmp_path / "contacts.yaml").write_text(CONTACTS)
    arguments = ("estimate", "--object", MUG, "--contacts", tmp_path / "contacts.yaml")
    benchmark.pedantic(run, (START, *arguments), rounds=5, warmup_rounds=1)
    show(f"tactopose estimate, a known object: {benchmark.stats.stats.median:.2f} s of wall time")


def test_first_estimates_of_a_process(benchmark: Any) -> None:
    run(FIRST, MUG, model_path("objects", "bust.obj"))
    lines = benchmark.pedantic(run, (FIRST, MUG, model_path("objects", "bust.obj")), rounds=1).splitlines()
    for what, line in zip(("first", "second"), lines, strict=True):
        ready, first, later = map(float, line.split())
        show(f"{what} object of a process: model {ready:.0f} ms, first estimate {first:.0f} ms, later {later:.1f} ms")


def test_compilation_from_source(benchmark: Any, tmp_path: Path) -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    benchmark.pedantic(run, (ALL.format(calls=CALLS),), {"NUMBA_CACHE_DIR": str(tmp_path)}, rounds=1)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    show(
        f"all that estimates, tracking and contacts compile: {after.ru_utime - before.ru_utime:.0f} s of processor time"
    )


@pytest.mark.parametrize("way", ["one by one", "at a time"])
def test_many_touches(benchmark: Any, way: str) -> None:
    model = tp.ObjectModel.from_mesh(MUG)
    contacts = touches(model, 200)
    calls: dict[str, Callable[[], object]] = {
        "one by one": lambda: [tp.estimate_pose(model, one) for one in contacts],
        "at a time": lambda: tp.estimate_poses(model, contacts),
    }
    benchmark.pedantic(calls[way], rounds=3, warmup_rounds=1)
    show(f"many touches {way}: {len(contacts) / benchmark.stats.stats.median:.0f} estimates a second")
