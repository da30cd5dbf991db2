from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from phantom_dyn import load_robot
from phantom_dyn.effects.drive.cogging import Cogging
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.position_waves import comes_back, order_range, orders_in
from places import ROBOTS
from tilt import recorded

EFFECT = Cogging()
THETA = np.array([6.0, 24.5, 0.03, 0.01, 0.7, -2.0])  # two orders, their amplitudes, their phases


def test_the_torque_follows_the_contract(arm, wide):
    # Contract: sum of A sin(n q + p).
    q = wide.q[:, 1]
    expected = 0.03 * np.sin(6 * q + 0.7) + 0.01 * np.sin(24.5 * q - 2.0)
    np.testing.assert_allclose(EFFECT.torque(arm, wide, "tilt", THETA)[:, 1], expected, atol=1e-14)


@pytest.mark.parametrize("order", [6.0, 17.0, 48.0])
def test_a_planted_order_is_found_among_noise(arm, wide, rng, order):
    # Known truth: a wave of half the noise's deviation, beside a wrong friction and a wrong scale of the model.
    noise = 0.02 * rng.normal(size=len(wide.t))
    rest = -0.05 * np.sign(wide.v[:, 1]) - 0.02 * wide.tau[:, 1] + noise
    wave = 0.01 * np.sin(order * wide.q[:, 1] + 1.0)
    assert EFFECT.shapes(arm, recorded(wide, wave + rest), "tilt")[0] == (order,)


def test_an_order_between_whole_numbers_is_found(arm, wide, rng):
    wave = 0.02 * np.sin(15.4 * wide.q[:, 1] + 1.0) + 0.01 * rng.normal(size=len(wide.t))
    ((order,), *_) = EFFECT.shapes(arm, recorded(wide, wave), "tilt")
    assert order == pytest.approx(15.4, abs=0.02)


def test_two_planted_orders_are_found_strongest_first(arm, wide, rng):
    q = wide.q[:, 1]
    wave = 0.02 * np.sin(12 * q) + 0.01 * np.cos(42 * q) + 0.005 * rng.normal(size=len(q))
    shapes = EFFECT.shapes(arm, recorded(wide, wave), "tilt")
    assert shapes[:2] == ((12.0,), (12.0, 42.0))


def test_as_many_orders_are_found_as_are_planted(arm, wide, rng):
    # Known truth: five waves of 4 to 1 times the deviation of the noise.
    q = wide.q[:, 1]
    planted = {12.0: 0.02, 42.0: 0.014, 28.0: 0.01, 36.0: 0.007, 19.0: 0.005}
    wave = sum(amplitude * np.sin(n * q + n) for n, amplitude in planted.items())
    shapes = EFFECT.shapes(arm, recorded(wide, wave + 0.005 * rng.normal(size=len(q))), "tilt")
    assert set(max(shapes, key=len)) == set(planted)


def test_the_fit_at_the_orders_found_gives_amplitude_and_phase(arm, wide, rng):
    # Known truth within four standard deviations of 5000 samples.
    torque = EFFECT.torque(arm, wide, "tilt", np.array([12.0, 0.02, 0.7]))[:, 1]
    operation = recorded(wide, torque + 0.005 * rng.normal(size=len(torque)))
    shape = EFFECT.shapes(arm, operation, "tilt")[0]
    column = EFFECT.signature(arm, operation, "tilt", shape).columns[:, 0]
    coefficients = np.linalg.lstsq(column, (operation.logged - operation.tau)[:, 1], rcond=None)[0]
    deviation = 4 * 0.005 * np.sqrt(2 / 5000)
    np.testing.assert_allclose(
        EFFECT.from_coefficients(arm, "tilt", coefficients, shape), [12.0, 0.02, 0.7],
        atol=max(deviation, deviation / 0.02), rtol=0,
    )  # fmt: skip


def test_noise_alone_seldom_has_more_than_one_order_beside_the_largest(arm, wide, rng):
    draws = [EFFECT.shapes(arm, recorded(wide, rng.normal(size=len(wide.t))), "tilt") for _ in range(20)]
    single = [all(len(shape) == 1 for shape in shapes) and len(shapes) <= 2 for shapes in draws]
    assert sum(single) > 10


@pytest.mark.parametrize("run", ["slow2_nocomp_0", "slow2_nocomp_1", "slow2_slower_nocomp_0"])
def test_the_orders_of_a_real_motor_are_those_of_its_published_map(data_folder, run):
    # Published value: the cogging map of this motor (12 slots, 7 pole pairs) is dominated by 7, 28, 14, 36, 12.
    recording = np.load(data_folder / "odrive_cogging" / "slow_and_pull.npz")
    q = recording[f"{run}__pos_counts"] * 2 * np.pi / 8192
    t = recording[f"{run}__t"]
    v = uniform_filter1d(np.gradient(q, t), 101)
    still = np.zeros((len(t), 1))
    motor = load_robot(ROBOTS / "pendulum.urdf")
    operation = Operation(
        t, q[:, None], v[:, None], still, motor, still, still, recording[f"{run}__iq_A"][:, None].astype(float)
    )
    # One turn of the motor: what stands out in it, though seven periods are too few to claim a finding on.
    shapes = orders_in(operation, 0, whole_numbers=True)
    assert shapes[0] == (7.0,)
    assert len(shapes[2]) == 3
    assert set(shapes[2]) <= {7.0, 28.0, 14.0, 36.0, 12.0}


def test_a_wave_that_lies_above_the_judged_band_most_of_the_time_is_tried(arm, wide):
    # Known truth: at the speed of the slowest quarter of the time the wave is above the band's edge. Below that speed
    # the joint still turns it three times.
    order = float(np.ceil(1.3 * 2 * np.pi * 2.0 / np.percentile(np.abs(wide.v[:, 1]), 25)))
    left = np.zeros_like(wide.q)
    left[:, 1] = 0.2 * np.sin(order * wide.q[:, 1])
    operation = replace(wide, band_hz=2.0).after_fit(wide.expected, left)
    assert comes_back(operation, 1, order)
    assert EFFECT.shapes(arm, operation, "tilt")[0] == (order,)


def test_orders_end_where_the_slowest_eighth_of_the_time_is_above_the_judged_band(wide):
    # Closed form: at that eighth's speed, the wave has the frequency of the band's edge.
    _, high = order_range(replace(wide, band_hz=0.5), 1)
    assert high == pytest.approx(2 * np.pi * 0.5 / np.percentile(np.abs(wide.v[:, 1]), 12.5))


def test_a_joint_at_rest_cannot_show_it(arm, wide):
    assert EFFECT.untestable(arm, wide, "turn") == (
        "turn travels less than one period of any cogging that its sampling rate can show"
    )
    assert EFFECT.shapes(arm, wide, "turn") == ()
    assert EFFECT.untestable(arm, wide, "tilt") is None


def test_the_probe_is_a_wave_of_amplitude_one_and_phase_zero(arm, wide):
    name, direction = EFFECT.probe(arm, wide, "tilt")
    assert name == "amplitude"
    np.testing.assert_allclose(EFFECT.from_coefficients(arm, "tilt", direction, (6.0,)), [6.0, 1.0, 0.0], atol=1e-15)
