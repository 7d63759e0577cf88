import pickle

import numpy as np

import tactopose_drake as tp
from tactopose_drake.core.sensing.patches import describe_patch
from tactopose_drake.estimation.pickling import Sealed


def test_arrays_stay_read_only_and_keep_their_order() -> None:
    fixed, free = np.arange(6.0).reshape(2, 3), np.ones(3)
    fixed.setflags(write=False)
    value = {"fixed": fixed, "columns": np.asfortranarray(fixed), "free": free}
    value["columns"].setflags(write=False)
    again = pickle.loads(pickle.dumps(Sealed(value))).value
    for name, array in value.items():
        np.testing.assert_array_equal(again[name], array)
        assert again[name].flags.writeable == array.flags.writeable
        assert again[name].flags.f_contiguous == array.flags.f_contiguous


def test_what_is_inside_stays_read_only_too() -> None:
    p_PT = np.column_stack([np.linspace(0.0, 0.02, 5), np.zeros((5, 2))])
    patch = describe_patch(p_PT, np.full(5, 2e4), alpha=2e-8)
    (again,) = pickle.loads(pickle.dumps(Sealed((patch,)))).value
    for name, array in vars(patch).items():
        if isinstance(array, np.ndarray):
            assert getattr(again, name).flags.writeable == array.flags.writeable, name


def test_a_model_that_was_estimated_with_answers_alike_when_it_was_pickled() -> None:
    model = tp.ObjectModel.from_box((0.05, 0.07, 0.11))
    contacts = tp.Contacts(
        [[0.025, 0.0, 0.01], [-0.025, 0.01, 0.0], [0.0, 0.035, -0.02]], np.eye(3)[[0, 0, 1]] * [[1], [-1], [1]]
    )
    expected = tp.estimate_pose(model, contacts)
    again = tp.estimate_pose(pickle.loads(pickle.dumps(model)), contacts)
    assert again.hypotheses == expected.hypotheses
