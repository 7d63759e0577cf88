"""A short run of the kinds that damage meshes and caches; the fuzzer itself runs them by the thousand."""

import zlib
from collections import Counter

import numpy as np
import pytest

from tactopose_drake.errors import TactoposeError
from tests.fuzz import meshes


@pytest.mark.parametrize(("kind", "calls", "least"), [("repairs", 150, 40), ("models", 8, 2), ("caches", 40, 40)])
def test_what_is_accepted_is_sound_and_the_rest_refused(kind: str, calls: int, least: int) -> None:
    results: Counter[str] = Counter()
    for seed in range(calls):
        try:
            getattr(meshes, kind)(np.random.default_rng([zlib.crc32(kind.encode()), seed]))
            results["accepted"] += 1
        except TactoposeError:
            results["refused"] += 1
    assert results["accepted"] >= least
    assert results["accepted"] == calls or results["refused"] >= least
