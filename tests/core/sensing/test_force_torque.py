import numpy as np
import pytest

from tactopose_drake.core.poses import exp_so3, make_poses
from tactopose_drake.core.sensing.force_torque import ForceTorqueModel, measure, shift_matrix, weight_matrix
from tactopose_drake.errors import InvalidInputError

LOAD = np.array([0.01, -0.02, 0.003, 1.0, -2.0, 3.0])


def test_an_ideal_sensor_reads_the_load() -> None:
    measurement = measure(LOAD, np.full(6, 5.0), ForceTorqueModel())
    np.testing.assert_array_equal(measurement.F_S, LOAD)
    assert measurement.status == "ok"


def test_bias_and_noise_add_with_their_own_scale() -> None:
    noise = [1e-3, 2e-3, 3e-3, 0.1, 0.2, 0.3]
    measurement = measure(LOAD, np.array([1.0, -1, 2, -2, 3, -3]), ForceTorqueModel(noise=noise, bias=[0.5] * 6))
    np.testing.assert_allclose(measurement.F_S - LOAD, [0.501, 0.498, 0.506, 0.3, 1.1, -0.4], atol=1e-12)


def test_a_bias_drifts() -> None:
    model = ForceTorqueModel(bias=[0.1] * 6, drift=[0.0, 0.0, 0.0, 0.2, 0.0, -0.1])
    measurement = measure(LOAD, np.zeros(6), model, time=3.0)
    np.testing.assert_allclose(measurement.F_S - LOAD, [0.1, 0.1, 0.1, 0.7, 0.1, -0.2])


@pytest.mark.parametrize("counts", [0.3, 0.7, -0.3, -0.7, 100.6])
def test_readings_are_the_nearest_multiples_of_the_resolution(counts: float) -> None:
    resolution = [1 / 64e3] * 3 + [1 / 320] * 3
    F_S = measure(counts * np.array(resolution), np.zeros(6), ForceTorqueModel(resolution=resolution)).F_S
    np.testing.assert_allclose(F_S / resolution, np.full(6, round(counts)), atol=1e-9)


def test_a_load_beyond_the_range_is_held_at_its_end_and_named() -> None:
    model = ForceTorqueModel(range=[0.12] * 3 + [12.0, 12.0, 17.0])
    measurement = measure(np.array([0, 0.2, 0, -13.0, 5.0, 16.9]), np.zeros(6), model)
    np.testing.assert_array_equal(measurement.F_S, [0, 0.12, 0, -12.0, 5.0, 16.9])
    assert measurement.status == "saturated: m_y, f_x"


@pytest.mark.parametrize("load", [0.9, 0.99, 1.0, 5.0, -5.0, np.inf])
def test_a_range_that_is_no_whole_number_of_steps_is_read_at_its_end_and_never_exceeded(load: float) -> None:
    measurement = measure(np.full(6, load), np.zeros(6), ForceTorqueModel(range=[1.0] * 6, resolution=[0.35] * 6))
    np.testing.assert_array_equal(measurement.F_S, np.sign(load) * np.ones(6))
    assert measurement.saturated.all() == (abs(load) >= 1.0)


@pytest.mark.parametrize("load", [1.0, -1.1])
def test_an_axis_at_its_end_reads_the_range_also_where_the_nearest_step_lies_below(load: float) -> None:
    measurement = measure(np.full(6, load), np.zeros(6), ForceTorqueModel(range=[1.0] * 6, resolution=[0.8] * 6))
    np.testing.assert_array_equal(measurement.F_S, np.sign(load) * np.ones(6))
    assert measurement.saturated.all()


def test_a_load_that_is_nan_is_no_signal() -> None:
    measurement = measure(np.full(6, np.nan), np.zeros(6), ForceTorqueModel(range=[1.0] * 6, resolution=[0.1] * 6))
    assert np.all(np.isnan(measurement.F_S))
    assert measurement.status == "no signal"


def test_a_load_of_which_one_number_is_nan_is_no_signal() -> None:
    measurement = measure(np.array([0.0, 0.0, 0.0, 1.0, np.nan, 5.0]), np.zeros(6), ForceTorqueModel(range=[2.0] * 6))
    np.testing.assert_array_equal(measurement.F_S, [0.0, 0.0, 0.0, 1.0, np.nan, 2.0])
    assert measurement.status == "no signal"


def test_a_weight_acts_at_the_centre_of_mass() -> None:
    F_S = weight_matrix(0.02, np.array([0.0, 0.0, 0.03])) @ [9.81, 0.0, 0.0]
    np.testing.assert_allclose(F_S, [0, 0.03 * 0.1962, 0, 0.1962, 0, 0])


def test_a_shifted_wrench_does_the_same_work() -> None:
    generator = np.random.default_rng(0)
    R_SJ, p_SJ = exp_so3(generator.normal(size=3)), generator.normal(size=3)
    F_J, w_S, v_S = generator.normal(size=(2, 3)).ravel(), *generator.normal(size=(2, 3))
    F_S = shift_matrix(make_poses(R_SJ, p_SJ)) @ F_J
    w_J, v_J = R_SJ.T @ w_S, R_SJ.T @ (v_S + np.cross(w_S, p_SJ))  # the same rigid motion, seen at J
    assert F_S @ np.concatenate([w_S, v_S]) == pytest.approx(F_J @ np.concatenate([w_J, v_J]))


@pytest.mark.parametrize(
    ("field", "values", "message"),
    [
        ("range", [1, 1, 0, 1, 1, 1], "range\\[2\\] must be .*, not 0"),
        ("noise", [0, 0, -1e-3, 0, 0, 0], "noise\\[2\\] must be .*, not -0.001"),
        ("resolution", [0, 0, -1, 0, 0, 0], "resolution\\[2\\] must be .*, not -1"),
        ("bias", [0, 0, 0], "bias must have the shape .*"),
        ("bias", [0, 0, 0, 0, 0, np.nan], r"bias\[5\] must be .*, not nan"),
    ],
)
def test_a_bad_parameter_is_named(field: str, values: list[float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        ForceTorqueModel(**{field: values}).validate()
