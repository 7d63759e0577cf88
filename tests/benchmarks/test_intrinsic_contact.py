"""Solves a second of the intrinsic contact solver, batched and singly, and its accuracy with a Nano17's noise.

`pytest -n 0 -s tests/benchmarks/test_intrinsic_contact.py` prints them; --benchmark-json keeps them as extra_info.
"""

import itertools
from typing import Any

import numpy as np
import pytest

from tactopose_drake.core.sensing.intrinsic_contact import solve_contact, solve_contacts
from tactopose_drake.core.sensing.soft_layer import SoftLayer
from tactopose_drake.core.surfaces import Surface
from tests.core.touches import SURFACES, touch

BATCH = 10_000
NANO17 = np.array([1 / 64e3] * 3 + [1 / 320] * 3)  # N m and N, one sigma


def noisy_touches(surface: Surface, layer: SoftLayer | None) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(0)
    touches = touch(surface, generator, BATCH, force=1.0, friction=0.8, patch_radius=0.001, layer=layer)
    return touches.F_S + generator.normal(size=(BATCH, 6)) * NANO17, touches.p_SC


def report(benchmark: Any, what: str, solves: int) -> None:
    rate = solves / benchmark.stats.stats.median
    benchmark.extra_info["solves_per_s"] = rate
    print(f"\n{what}: {rate:,.0f} solves/s")  # noqa: T201


@pytest.mark.parametrize("layer", [None, SoftLayer(thickness=0.002, stiffness=10e3)], ids=["rigid", "soft"])
@pytest.mark.parametrize("name", SURFACES)
def test_batched(benchmark: Any, name: str, layer: SoftLayer | None) -> None:
    F_S, p_SC = noisy_touches(SURFACES[name], layer)
    found = benchmark.pedantic(solve_contacts, (F_S, SURFACES[name]), {"layer": layer}, rounds=20, warmup_rounds=1)
    error = np.sqrt(np.nanmean(np.sum((found.p_SC - p_SC) ** 2, axis=1)))
    benchmark.extra_info["rms_error_um"] = 1e6 * error
    report(benchmark, f"{name}, batched, {1e6 * error:.1f} um rms, {found.valid.mean():.2%} valid", BATCH)


@pytest.mark.parametrize("name", SURFACES)
def test_singly(benchmark: Any, name: str) -> None:
    F_S, _ = noisy_touches(SURFACES[name], None)
    wrenches = itertools.cycle(F_S)
    benchmark(lambda: solve_contact(next(wrenches), SURFACES[name]))
    report(benchmark, f"{name}, singly", 1)
