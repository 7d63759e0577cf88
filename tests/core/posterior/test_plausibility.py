"""What may be touched: laws of the reach."""

import numpy as np
import pytest

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import compose, exp_so3
from tactopose_drake.core.posterior.plausibility import may_be_touched
from tests.core.tracking.boxes import make_box, touch

EXACT = 1e-12 * np.eye(6)


@pytest.mark.parametrize("seed", range(5))
def test_an_object_may_be_what_is_touched_where_it_is_however_sure_one_is(seed: int) -> None:
    generator, box = np.random.default_rng(seed), make_box()
    X_PO = np.column_stack([exp_so3(generator.normal(size=3)), generator.normal(size=3)])
    assert may_be_touched(box, X_PO, EXACT, touch(X_PO, generator))


def test_it_may_not_be_metres_away_unless_it_is_known_to_metres_only() -> None:
    box, X_PO = make_box(), np.eye(3, 4)
    contacts = touch(X_PO, np.random.default_rng(0))
    off = np.array([2.0, 0.0, 0.0])
    away = np.column_stack([X_PO[:, :3], off])
    assert not may_be_touched(box, away, EXACT, contacts)
    assert may_be_touched(box, away, np.diag(np.repeat([1e-12, 0.4**2], 3)), contacts)
    one_near = Contacts(np.concatenate([contacts.p_PC, contacts.p_PC[:1] + off]))
    assert may_be_touched(box, away, EXACT, one_near), "one contact within reach is enough"


def test_the_answer_moves_with_the_frame() -> None:
    box, generator = make_box(), np.random.default_rng(1)
    for distance in (0.1, 0.2, 0.25, 0.3, 0.4, 1.0):
        X_PO = np.column_stack([np.eye(3), [0.0, 0.0, 0.0]])
        contacts = touch(X_PO, generator)
        shifted = np.column_stack([np.eye(3), [distance, 0.0, 0.0]])
        move = np.column_stack([exp_so3(generator.normal(size=3)), generator.normal(size=3)])
        moved = Contacts(contacts.p_PC @ move[:, :3].T + move[:, 3])
        answers = [may_be_touched(box, X, EXACT, c) for X, c in ((shifted, contacts), (compose(move, shifted), moved))]
        assert answers[0] == answers[1]
