import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactopose_drake.core.evidence.contact_doubt import ContactKinds, KindShares

KINDS = ContactKinds(turned=1.0, displaced=6.0)
probabilities = st.floats(0.0, 0.99)


@given(probabilities)
def test_the_probability_is_that_of_something_else_and_all_of_them_sum_to_one(p: float) -> None:
    for shares in (KINDS.shares(p), KINDS.shares(p).without_normals()):
        assert shares.other == p
        assert sum(shares) == pytest.approx(1.0, abs=1e-12)
        assert min(shares) >= 0.0
        assert shares.false == pytest.approx(1.0 - shares.as_told, abs=1e-12)


@given(probabilities, probabilities)
def test_the_more_is_of_something_else_the_less_is_as_told(p: float, q: float) -> None:
    less, more = sorted((p, q))
    assert KINDS.shares(more).as_told <= KINDS.shares(less).as_told


@given(st.floats(1e-9, 0.99))
def test_the_odds_of_the_other_kinds_are_as_many_times_those_of_something_else(p: float) -> None:
    shares = KINDS.shares(p)
    assert shares.displaced / shares.as_told == pytest.approx(6.0 * p / (1.0 - p), rel=1e-9)
    assert shares.turned / shares.as_told == pytest.approx(p / (1.0 - p), rel=1e-9)
    more = dataclasses.replace(KINDS, flipped=3.0, lost=2.0).shares(p)
    assert more.lost / more.as_told == pytest.approx(2.0 * p / (1.0 - p), rel=1e-9)
    assert more.other == p
    assert more.flipped / more.as_told == pytest.approx(3.0 * p / (1.0 - p), rel=1e-9)
    assert more.false == pytest.approx(1.0 - more.as_told, abs=1e-12)
    assert sum(more) == pytest.approx(1.0, abs=1e-12)


def test_without_doubt_every_contact_is_as_told_and_where_there_is_no_normal_none_is_another() -> None:
    assert KINDS.shares(0.0) == KindShares(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    shares = dataclasses.replace(KINDS, flipped=3.0).shares(0.02)
    told = shares.as_told + shares.flipped + shares.turned
    assert shares.without_normals() == (told, 0.0, 0.0, shares.displaced, 0.02, 0.0)


@pytest.mark.parametrize(("count", "share"), [(1, 0.1), (3, 0.1), (4, 0.55), (5, 1.0), (12, 1.0)])
def test_a_contact_is_the_false_one_the_more_often_the_more_others_are_left_to_judge_it(
    count: int, share: float
) -> None:
    among = ContactKinds(flipped=2.0, turned=3.0, displaced=5.0, lost=8.0).among(count)
    assert dataclasses.astuple(among) == pytest.approx((2.0 * share, 3.0 * share, 5.0 * share, 8.0 * share))
