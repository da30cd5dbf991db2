from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from phantom_dyn import load_robot
from phantom_dyn.effects.drive.input_delay import InputDelay, _mean_held
from phantom_dyn.effects.operation import Operation

EFFECT = InputDelay()
W = 10.0  # rad/s


@pytest.fixture(scope="module")
def sine(arm, smooth) -> Operation:
    """The drives are to give sines of 3, 2 and 1 N m."""
    return replace(smooth, expected=np.sin(W * smooth.t)[:, None] * [3.0, 2.0, 1.0])


@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.002, 0.0123])
def test_the_command_of_a_sine_is_the_sine_a_delay_later(arm, sine, delay):
    # Closed form; the delays are no multiples of the 2 ms between samples.
    command = sine.expected - EFFECT.torque(arm, sine, None, np.array([delay]))
    ahead = np.sin(W * (sine.t + delay))[:, None] * [3.0, 2.0, 1.0]
    np.testing.assert_allclose(command[5:-10], ahead[5:-10], atol=3e-6)


def test_uneven_samples_give_the_same_command(arm, sine):
    t = sine.t + 0.0005 * np.sin(np.arange(len(sine.t)))
    uneven = replace(sine, t=t, expected=np.sin(W * t)[:, None] * np.ones(3))
    command = uneven.expected - EFFECT.torque(arm, uneven, "tilt", np.array([0.005]))
    np.testing.assert_allclose(command[5:-10, 1], np.sin(W * (t[5:-10] + 0.005)), atol=1e-5)


@pytest.mark.parametrize("joint", [None, "slide"])
def test_the_column_is_exact_where_coefficient_and_shape_agree(arm, sine, joint):
    signature = EFFECT.signature(arm, sine, joint, (0.007,))
    torque = EFFECT.torque(arm, sine, joint, np.array([0.007]))[:, list(signature.rows)]
    np.testing.assert_allclose(torque, -signature.columns @ [0.007], atol=1e-14)


def test_a_delay_of_one_joint_touches_no_other(arm, sine):
    assert EFFECT.signature(arm, sine, "tilt", (0.002,)).rows == (1,)
    assert np.all(EFFECT.torque(arm, sine, "tilt", np.array([0.01]))[:, [0, 2]] == 0)


def test_the_next_shape_is_the_last_estimate(arm):
    assert EFFECT.refined(np.array([0.0043]), (0.002,)) == ((0.0043,),)
    assert EFFECT.refined(np.array([-0.001]), (0.002,)) == ((1e-5,),)


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.0051, 0.0199])
def test_a_simulated_drive_is_late_by_the_delay(arm, given_in_steps, sine, delay):
    # Closed form, up to what the hold leaves: a command is given in the step that it is asked for, if nothing is late.
    command = np.sin(W * sine.t)[:, None] * np.ones(3)
    given = given_in_steps(EFFECT.simulated(arm, None, np.array([delay])), sine.t, command)
    late = np.sin(W * (sine.t - delay))
    np.testing.assert_allclose(given[20:, 1], late[20:], atol=1e-3)


def test_a_delay_of_whole_steps_shifts_the_commands(arm, given_in_steps, rng):
    command = rng.normal(size=(30, 3))
    given = given_in_steps(EFFECT.simulated(arm, "tilt", np.array([0.03])), np.arange(30) * 0.01, command)
    np.testing.assert_allclose(given[3:, 1], command[:-3, 1], atol=1e-12)
    np.testing.assert_array_equal(given[:, [0, 2]], command[:, [0, 2]])


def test_uneven_steps_give_the_same_impulse_as_even_ones(arm, given_in_steps, rng):
    command = rng.normal(size=(20, 3))
    simulated = EFFECT.simulated(arm, None, np.array([0.0137]))
    whole = given_in_steps(simulated, np.arange(20) * 0.01, command)
    t = (np.arange(20)[:, None] * 0.01 + np.array([0.0, 0.002, 0.009])).ravel()
    parts = given_in_steps(simulated, t, np.repeat(command, 3, axis=0)).reshape(20, 3, 3)
    np.testing.assert_allclose(np.einsum("p,kpj->kj", [0.2, 0.7, 0.1], parts)[:-1], whole[:-1], atol=1e-12)


def test_the_history_is_no_longer_than_needed(arm, rng):
    simulated = EFFECT.simulated(arm, "tilt", np.array([0.02]))
    state = simulated.start
    for tau in rng.normal(size=(500, 3)):
        state, _ = simulated.command(state, 0.01, tau)
    assert len(state) <= 2 * 4


def test_on_a_robot_with_one_joint_the_delay_is_that_joint_s(arm):
    pendulum = load_robot(arm.source.replace("arm3", "pendulum"))
    assert EFFECT.places(pendulum) == pendulum.joint_names
    assert EFFECT.places(arm) == (None, "turn", "tilt", "slide")


@pytest.mark.parametrize(
    ("dt", "delays"),
    # By hand: 2 ms are within a fifth of 2.4 ms, and not of 2.6 ms; less than 10 us is rounding.
    [
        (0.0024, (0.0024, 0.005, 0.012)),
        (0.0026, (0.0026, 0.002, 0.005, 0.012)),
        (0.01, (0.01, 0.002, 0.005)),
        (1e-6, (1e-5, 0.002, 0.005, 0.012)),
    ],
)
def test_delays_that_are_tried_differ_from_one_sample_by_more_than_a_fifth(arm, sine, dt, delays):
    operation = replace(sine, t=dt * np.arange(len(sine.t)))
    assert [delay for (delay,) in EFFECT.shapes(arm, operation, None)] == pytest.approx(delays)


def test_a_single_sample_is_not_ahead(arm, sine):
    series = ("t", "q", "v", "a", "tau", "expected", "logged", "temperature")
    one = replace(sine, **{name: getattr(sine, name)[:1] for name in series})
    assert not EFFECT.torque(arm, one, None, np.array([0.01])).any()


@pytest.mark.parametrize(
    ("start", "stop", "mean"),
    [(-0.5, -0.3, 3.0), (-0.6, -0.2, 3.5), (-2.0, -1.2, 1.0), (-1.1, -0.1, 3.2), (-0.1, 0.0, 7.0)],
)
def test_the_mean_of_held_commands_counts_each_for_its_time(start, stop, mean):
    # By hand: 1 until -1, 3 until -0.3, 5 until -0.1 and 7 until now; before the first its command holds.
    history = np.array([[0.2, 1.0], [0.7, 3.0], [0.2, 5.0], [0.1, 7.0]])
    assert _mean_held(history, np.array([-1.0, -0.3, -0.1, 0.0]), start, stop) == pytest.approx([mean])


def test_no_drive_is_early_nor_late_by_a_second(arm):
    assert EFFECT.coefficient_bounds(arm, None, (0.002,)) == ((0.0, 1.0),)


@pytest.mark.parametrize("delay", [0.0007, 0.002, 0.0123, 5.0])
def test_even_samples_have_the_command_of_the_curve_through_them(arm, smooth, rng, delay):
    # Oracle: scipy's Hermite spline with the slopes of neighbours, held behind the end.
    rough = replace(smooth, expected=rng.normal(size=smooth.tau.shape))
    curve = CubicHermiteSpline(rough.t, rough.expected, np.gradient(rough.expected, rough.t, axis=0))
    wanted = curve(np.minimum(rough.t + delay, rough.t[-1]))
    command = rough.expected - EFFECT.torque(arm, rough, None, np.array([delay]))
    np.testing.assert_allclose(command, wanted, atol=1e-8)
