import dataclasses

import numpy as np
import pytest

from tests.examples.scripts import share_script

METHODS = share_script("thesis/chapter_3_methods.py")


@pytest.mark.parametrize("row", [*METHODS.THESIS_ROWS[2:], *METHODS.OUR_ROWS])
def test_a_row_looks_at_normals_only_if_it_says_so(row: tuple[str, str]) -> None:
    objects = share_script("thesis/cube_and_cylinder.py")
    shape = objects.make_shapes()["cube"]
    trial = objects.make_trial(shape, np.random.default_rng(0))
    other_normals = dataclasses.replace(trial.contacts, n_PC=np.roll(trial.contacts.n_PC, 1, axis=1))
    solve = METHODS.make_solvers()[row]
    X_PO, X_PO_other = (
        solve(shape, objects.Trial(contacts, trial.prior)).X_PO for contacts in (trial.contacts, other_normals)
    )
    assert np.array_equal(X_PO, X_PO_other) == (row[1] in ("w_n = 0", "distance"))
