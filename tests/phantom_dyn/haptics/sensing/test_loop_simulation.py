"""Loops in time: against the exact sampled form, closed forms, and their own bookkeeping."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.published import PHANTOM_1_5_Z
from phantom_dyn.haptics.sensing.encoder import Encoder
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings, LoopTrace, gain_until_swinging, simulate_loop
from phantom_dyn.haptics.stability.sampled_loop import SampledLoop

FINE = Encoder(1e-9)
RIGID = RigidAxis(0.05, 1.0)
TWO_MASS = TwoMassAxis(0.02, 0.03, 0.3, 0.3, 5e3, 0.5)


@pytest.mark.parametrize("delay", [0.0, 0.35e-3, 1.6e-3])
@pytest.mark.parametrize("axis", [RIGID, TWO_MASS], ids=["rigid", "two masses"])
def test_a_fine_encoder_gives_the_exact_sampled_loop(axis, delay):
    settings = LoopSettings(delay=delay, encoder=FINE)
    trace = simulate_loop(
        (axis,), settings, gain=300.0, damping=0.0, start=(1e-3,), speed=(0.0,), hand=np.zeros((200, 1))
    )
    loop = SampledLoop((discretise(axis, period=1e-3, delay=delay),))
    matrix, state = loop.closed_loop(300.0), np.zeros(loop.closed_loop(300.0).shape[0])
    state[: len(axis.state_space.B)] = axis.rest(1e-3)
    exact = np.empty(200)
    for k in range(200):
        exact[k] = loop.plant.output @ state[: len(loop.plant.output)]
        state = matrix @ state
    np.testing.assert_allclose(trace.position[:, 0], exact, rtol=0, atol=2e-8)


def test_a_free_push_is_the_matrix_exponential():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=0.0, damping=0.0, start=(0.0,), speed=(0.2,), hand=np.full((101, 1), 0.5)
    )
    A = np.array([[0, 1, 0], [0, -1.0 / 0.05, 0.5 / 0.05], [0, 0, 0]])
    assert trace.position[-1, 0] == pytest.approx((expm(A * 0.1) @ [0, 0.2, 1])[0], rel=1e-9)


def test_readings_are_the_rounded_position():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=100.0, damping=0.0, start=(2e-3,), speed=(0.1,), hand=np.zeros((300, 1))
    )
    step = LoopSettings().encoder.step
    np.testing.assert_allclose(trace.reading, np.floor(trace.position / step + 0.5) * step, rtol=0, atol=1e-15)


def test_a_wall_pushes_only_from_inside():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=500.0, damping=0.0, start=(0.0,), speed=(0.1,), hand=np.zeros((300, 1)),
        one_sided=True,
    )  # fmt: skip
    inside = trace.reading > 0
    np.testing.assert_allclose(trace.force[inside], -500.0 * trace.reading[inside], rtol=1e-12)
    assert inside.any()
    assert not trace.force[~inside].any()


def test_a_position_that_answers_at_once_is_read_before_its_force_acts():
    trace = simulate_loop(
        (PHANTOM_1_5_Z,), LoopSettings(), gain=0.0, damping=0.0, start=(0.0,), speed=(0.0,), hand=np.ones((3, 1))
    )
    assert trace.position[0, 0] == 0.0
    # One millisecond of force: its feed-through, and what the poles have added to it.
    assert trace.position[1, 0] > PHANTOM_1_5_Z.state_space.D


def test_a_loop_that_runs_away_ends_there():
    trace = simulate_loop(
        (RIGID,), LoopSettings(), gain=1e6, damping=0.0, start=(1e-3,), speed=(0.0,), hand=np.zeros((2000, 1))
    )
    assert trace.ran_away
    assert len(trace.t) < 2000


def swinging(decay: float) -> LoopTrace:
    t = np.arange(3000) * 1e-3
    x = (np.exp(-decay * t) * np.sin(50 * t))[:, None] * 1e-3
    return LoopTrace(t, x, x, x, x, False)


@pytest.mark.parametrize(("decay", "lasts"), [(0.0, True), (-1.0, True), (1.0, False)])
def test_a_swing_lasts_if_it_does_not_decay(decay, lasts):
    assert swinging(decay).keeps_swinging(1e-5) is lasts


def test_a_swing_of_less_than_ten_steps_is_rounding():
    assert not swinging(0.0).keeps_swinging(1e-3)


def test_bisection_finds_the_gain_from_which_on_a_swing_lasts():
    found = gain_until_swinging(lambda gain: swinging(0.5 * (7.0 - gain)), 1e-5, low=1.0, high=100.0)
    assert found == pytest.approx(7.0, rel=0.06)  # nine tenths in a second is a decay of 0.1


def test_a_swing_at_the_lowest_gain_is_a_limit_of_nothing_and_none_at_the_highest_no_limit():
    assert gain_until_swinging(lambda _: swinging(0.0), 1e-5, low=1.0, high=2.0) == 0.0
    assert gain_until_swinging(lambda _: swinging(1.0), 1e-5, low=1.0, high=2.0) == np.inf


def test_gains_in_the_wrong_order_are_refused():
    with pytest.raises(ParameterError, match="give two above 0, the lower one first"):
        gain_until_swinging(lambda _: swinging(0.0), 1e-5, low=2.0, high=1.0)


def test_a_delay_between_the_substeps_is_refused():
    with pytest.raises(ParameterError, match="give a multiple of 5e-05 s"):
        LoopSettings(delay=0.33e-4)


def test_a_period_of_nothing_is_refused():
    with pytest.raises(ParameterError, match="period of the loop is 0"):
        LoopSettings(period=0.0)


def test_three_devices_are_refused():
    with pytest.raises(ParameterError, match="give one or two devices and as many of each"):
        simulate_loop(
            (RIGID,) * 3, LoopSettings(), gain=1.0, damping=0.0, start=(0.0,) * 3, speed=(0.0,) * 3,
            hand=np.zeros((10, 3)),
        )  # fmt: skip
