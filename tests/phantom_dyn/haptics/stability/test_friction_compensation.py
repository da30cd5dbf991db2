"""Compensated friction: power, trembling at rest, dither and over-compensation, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from compensated_axis import DryFriction, Sampling, simulate_compensation
from phantom_dyn import load_robot
from phantom_dyn.devices import phantom as closed
from phantom_dyn.dynamics.dynamics import gravity_torque, modelled_friction
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.stability.friction_compensation import (
    FrictionCompensation,
    assisting_torque,
    dithered_damping,
    largest_share,
    least_dead_zone,
)
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.simulate import simulate

# About a PHANToM at its tip, held by a spring of 50 N/m: 27 rad/s.
MASS, T, SLIP = 0.07, 0.1, 2e-5
HELD = RigidAxis(MASS, 0.2, 50.0)
FREE = RigidAxis(MASS, 0.2)
TRUE = DryFriction(T, SLIP)
REST = least_dead_zone(MASS, T, SLIP)
NOBODY = np.zeros(4000)


def moved(axis, share, *, dead_zone=REST, modelled=(T, 0.0), sampling=None, hand=NOBODY, speed=0.3):
    given = FrictionCompensation(share, dead_zone)
    return simulate_compensation(axis, TRUE, given, modelled, sampling or Sampling(), hand, speed=speed)


def test_the_largest_share_compensates_friction_that_is_modelled_too_large_exactly():
    # By hand: of friction that is modelled 10 % too large.
    assert largest_share(0.1) == pytest.approx(1 / 1.1)


@pytest.mark.parametrize("delay", [0, 5, 25])
@pytest.mark.parametrize("window", [1, 20])
def test_with_the_largest_share_no_delay_and_no_window_keeps_a_device_moving(delay, window):
    # Closed form: the power of the compensation is at most that of the friction. The friction is modelled 10 % too
    # large, the encoder has steps of 30 um.
    sampling = Sampling(delay=delay, window=window, step=3e-5)
    dead = least_dead_zone(MASS, T, SLIP, step=3e-5, window=window)
    for axis in (HELD, FREE):
        found = moved(axis, largest_share(0.1), dead_zone=dead, modelled=(1.1 * T, 0.0), sampling=sampling)
        assert not found.force[-1000:].any()
        # What is left swings on the spring of the friction, and dies out.
        assert found.swing < SLIP
    assert np.abs(found.force).max() == pytest.approx(T)


@pytest.mark.parametrize("share", [1.2, 1.5])
def test_more_than_the_friction_swings_on_the_hand_as_wide_as_the_closed_form(share):
    # Closed form: the excess puts in 4 (f - T) A a period, the damper takes pi b w A^2.
    found = moved(HELD, share)
    assert found.swing == pytest.approx(4 * (share - 1) * T / (np.pi * 0.2 * np.sqrt(50.0 / MASS)), rel=0.06)


def test_more_than_the_friction_drives_a_free_device_to_the_speed_of_the_closed_form():
    # Closed form: (f - T) / b.
    assert moved(FREE, 1.3).velocity[-1] == pytest.approx(0.3 * T / 0.2, rel=0.01)


def test_without_a_dead_zone_a_device_trembles_at_rest_though_less_than_its_friction_is_given():
    # The friction yields as a spring there, which takes nothing.
    knocked = NOBODY.copy()
    knocked[10:13] = 0.05
    trembling = moved(FREE, 0.9, dead_zone=0.0, hand=knocked, speed=0.0)
    assert np.abs(trembling.velocity[-500:]).max() > 0.2 * REST
    still = moved(FREE, 0.9, hand=knocked, speed=0.0)
    assert np.abs(still.velocity[-500:]).max() < 1e-5


def test_a_moving_device_resists_by_what_is_left_of_its_friction():
    # Closed form: F = (1 - s) T + b v.
    found = moved(FREE, 0.9, hand=np.full(4000, 0.05), speed=0.1)
    assert found.velocity[-1] == pytest.approx((0.05 - 0.1 * T) / 0.2, rel=0.01)


def test_a_device_at_rest_resists_by_all_of_it():
    # The hand presses slowly: a blow of more than half of the friction overshoots on its spring, and slips.
    rising = np.clip(np.arange(6000) / 4000.0, 0.0, 1.0)
    still, moving = (moved(FREE, 0.9, hand=share * T * rising, speed=0.0) for share in (0.9, 1.1))
    assert abs(still.position[-1]) < 5 * SLIP
    assert moving.velocity[-1] > 0.3


def test_viscous_friction_is_compensated_too():
    # Closed form: F = (1 - s) (T + b v).
    found = moved(FREE, 0.8, modelled=(T, 0.2), hand=np.full(8000, 0.05), speed=0.1)
    assert found.velocity[-1] == pytest.approx((0.05 - 0.2 * T) / (0.2 * 0.2), rel=0.02)


def test_a_ramp_rises_from_nothing_to_the_whole():
    given = FrictionCompensation(0.5, 0.1, 0.2)
    found = given.force(np.array([0.05, 0.1, 0.2, 0.3, -0.3, 1.0]), 2.0, 0.0)
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 1.0, -1.0, 1.0], atol=1e-12)


def test_dither_turns_dry_friction_into_a_damper():
    # Closed form: the describing function of a relay; the friction yields over a tenth of a micrometre.
    t, w = np.arange(6000) * 1e-4, 2 * np.pi * 60.0
    damper = dithered_damping(MASS, T, amplitude=0.5, frequency=w)
    none, sharp = FrictionCompensation(0.0, 0.0), DryFriction(T, 1e-7)
    sampling = Sampling(period=1e-4)
    slow = [
        simulate_compensation(RigidAxis(MASS, 0.0), sharp, none, (0.0, 0.0), sampling, push + 0.5 * np.cos(w * t))
        for push in (0.0, 0.01)
    ]
    drift = [np.mean(one.velocity[-1000:]) for one in slow]
    assert drift[1] - drift[0] == pytest.approx(0.01 / damper, rel=0.1)


def test_a_dither_that_does_not_break_the_friction_is_refused():
    with pytest.raises(ParameterError, match=r"A dither of 0\.12 does not keep .* moving: give more than 0\.127"):
        dithered_damping(MASS, T, amplitude=0.12, frequency=400.0)


def test_an_encoder_with_coarse_steps_needs_a_wider_dead_zone():
    # By hand: one step of 30 um over ten samples of a millisecond.
    assert least_dead_zone(MASS, T, SLIP, step=3e-5, window=1) == pytest.approx(0.03)
    assert least_dead_zone(MASS, T, SLIP, step=3e-5, window=10) == pytest.approx(np.sqrt(T * SLIP / MASS))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: largest_share(-0.1), "uncertainty is -0.1: give a number of 0 or more"),
        (lambda: FrictionCompensation(np.nan, 0.0), "share is nan"),
    ],
)
def test_numbers_that_cannot_be_are_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


@pytest.fixture(scope="module")
def rubbing() -> Robot:
    """The PHANToM with dry and viscous friction on all joints, the passive ones too."""
    robot = load_robot("phantom_1_5")
    chain, full = robot.chain, np.full(3, 0.02)
    assert chain is not None
    chain = replace(chain, coulomb_friction=np.full(2, 0.01), viscous_friction=np.full(2, 1e-4))
    return replace(robot, chain=chain, coulomb_friction=full, viscous_friction=0.05 * full, torque_hold="zoh")


def test_a_robot_is_given_its_weight_and_the_share_of_its_friction(rubbing, rng):
    # Oracles: the device's closed form of the weight, the friction of inverse dynamics.
    q, v = rng.uniform(-0.4, 0.4, (6, 3)), rng.uniform(0.3, 0.6, (6, 3)) * [1, -1, 1]
    found = assisting_torque(rubbing, q, v, FrictionCompensation(0.8, 0.01))
    expected = closed.gravity_torque(q) + 0.8 * modelled_friction(rubbing, Motion(np.arange(6.0), q, v, 0 * v))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    slow = assisting_torque(rubbing, q, 0.01 * v, FrictionCompensation(0.8, 0.05))
    np.testing.assert_allclose(slow, gravity_torque(rubbing, q), atol=1e-15)


@pytest.mark.whole
def test_positions_and_velocities_may_be_lists(rubbing):
    q, v, given = [[0.1, 0.2, -0.1]], [[0.0, 0.5, -0.5]], FrictionCompensation(0.8, 0.01)
    expected = assisting_torque(rubbing, np.array(q), np.array(v), given)
    np.testing.assert_array_equal(assisting_torque(rubbing, q, v, given), expected)


@pytest.mark.whole
def test_one_sample_without_its_row_is_refused_with_the_shape_that_is_wanted(rubbing):
    with pytest.raises(
        ParameterError, match=r"shape \(3,\) were given, wanted \(N, 3\) of both: give a row per sample"
    ):
        assisting_torque(rubbing, np.zeros(3), np.zeros(3), FrictionCompensation(0.8, 0.01))


def pushed_off(robot: Robot, share: float) -> np.ndarray:
    """Speeds of a robot that is pushed off, its weight and a share of its friction compensated at 1 kHz."""
    given = FrictionCompensation(share, 0.02)

    def controller(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return assisting_torque(robot, q[None], v[None], given)[0]

    t, start = np.arange(300) * 1e-3, np.array([0.0, 0.1, 0.1])
    return simulate(robot, (), controller, t, start, np.array([0.1, 0.1, -0.1])).links.v


@pytest.mark.whole
def test_a_robot_comes_to_rest_with_less_than_its_friction_and_runs_away_with_more(rubbing):
    calm, driven = (np.abs(pushed_off(rubbing, share)).max(axis=1) for share in (0.9, 1.5))
    assert calm[-1] < 0.01 * calm[0]
    assert driven[-1] > 1.5 * driven[0]
