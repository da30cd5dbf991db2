"""Friction of joints whose encoder stands. Oracle: closed forms of ramps with a known encoder."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.derivatives import differentiate, motion_edge
from identification.data.log import Band, Log
from identification.data.recording import Recording
from identification.data.signals import process
from identification.diagnosis.columns.motion.standstill import (
    creeping_std,
    direction_hidden,
    encoder_still,
    held_std,
    near_reversals,
    standstill_std,
    uncertain_friction_variance,
)
from identification.diagnosis.columns.operations import friction_torque_with
from identification.diagnosis.columns.terms import FoundEffect
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion

RATE = 1000.0
STEP = 2 * np.pi / 65536
T = np.arange(0, 4, 1 / RATE)


def log_of(q: np.ndarray, step: float = STEP) -> Log:
    """A log of one joint whose encoder rounds to a step."""
    q = q[:, None]
    v = np.gradient(q, 1 / RATE, axis=0)
    motion = Motion(T, q, v, np.zeros_like(q))
    band = Band(RATE, 20.0, np.hanning(103)[1:-1] / np.hanning(103).sum(), 5)
    valid = np.ones(len(T), dtype=bool)
    read = np.round(q / step) * step
    return Log("a.csv", ("pin",), motion, np.zeros_like(q), band, valid, raw_q=read, reading_steps=(step,))


def stopping() -> np.ndarray:
    """Half a radian per second, but for the second from 1 to 2, in which it stands."""
    return 0.5 * (np.minimum(T, 1.0) + np.maximum(T - 2.0, 0.0))


def test_an_encoder_stands_from_stop_to_start_and_a_few_milliseconds_about(pendulum):
    # Closed form: at half a radian per second a count passes in 0.2 ms.
    stands = encoder_still(pendulum, log_of(stopping()))[:, 0]
    assert stands[(T >= 1.0) & (T <= 2.0)].all()
    assert not stands[(T < 0.997) | (T > 2.003)].any()


@pytest.mark.parametrize(("counts", "stands"), [(1.9, True), (3.1, False)])
def test_a_joint_that_creeps_stands_up_to_two_counts_in_fifteen_milliseconds(pendulum, counts, stands):
    creep = np.where((T > 1) & (T < 2), T - 1, np.maximum(T - 2, 0.0) * 200 + (T > 1)) * counts * STEP / 0.014
    found = encoder_still(pendulum, log_of(creep))[:, 0]
    assert found[(T > 1.1) & (T < 1.9)].any() == stands


def test_an_encoder_too_coarse_to_tell_says_nothing(pendulum):
    # By hand: two counts and a swing of 0.02 rad at an eighth of a radian per second take 0.352 s.
    assert not encoder_still(pendulum, log_of(stopping(), step=0.02)).any()


def test_positions_without_known_counts_say_nothing(pendulum, rng):
    log = log_of(np.maximum(np.sin(3 * T), 0.3))
    unstated = replace(pendulum, actuators=(replace(pendulum.actuators[0], encoder_counts=None),))
    noisy = replace(log, raw_q=log.motion.q + 1e-5 * rng.normal(size=(len(T), 1)), reading_steps=(None,))
    assert not encoder_still(unstated, noisy).any()


def test_a_joint_that_stands_most_of_the_time_still_has_a_usual_speed(pendulum):
    # Known truth: it travels for half a second of four, half a radian per second.
    rare = 0.5 * np.clip(T - 1.0, 0.0, 0.5)
    stands = encoder_still(pendulum, log_of(rare))[:, 0]
    assert stands[(T < 1.0) | (T > 1.5)].all()
    assert not stands[(T > 1.003) & (T < 1.497)].any()


def test_a_reading_that_does_not_change_stands_where_no_count_is_known(pendulum, rng):
    # Known truth: readings at uneven times, made even, hold no counts any more.
    unstated = replace(pendulum, actuators=(replace(pendulum.actuators[0], encoder_counts=None),))
    moves = stopping() + 1e-5 * np.cumsum(rng.normal(size=len(T))) * ((T < 1.0) | (T > 2.0))
    moves[(T >= 1.0) & (T <= 2.0)] = 0.5
    log = log_of(stopping())
    stands = encoder_still(unstated, replace(log, raw_q=moves[:, None]))[:, 0]
    assert stands[(T >= 1.0) & (T <= 2.0)].all()
    assert not stands[(T < 0.99) | (T > 2.01)].any()


def read_coarsely(pendulum, q: np.ndarray) -> Log:
    """A motion at 100 Hz, read in steps of a 4096th of a turn, through the band's filters, which leave the steps."""
    t, step = np.arange(len(q)) / 100.0, 2 * np.pi / 4096
    read = np.round(q / step)[:, None] * step
    log = process(Recording("a.csv", ("pin",), t, read, np.zeros_like(read)), pendulum, cutoff_hz=6.0)
    motion = log.motion.with_joints(*differentiate(read, log.band.rate_hz, motion_edge(log.band)))
    return replace(log, motion=motion, position_edges=None)


@pytest.mark.parametrize(("speed", "backwards"), [(0.012, 0.5), (0.05, 0.0), (0.5, 0.0)])
def test_a_joint_that_creeps_from_count_to_count_hides_its_direction(pendulum, speed, backwards):
    # Known truth: it never moves backwards. At 0.012 rad/s a count passes in 0.13 s.
    log = read_coarsely(pendulum, speed * np.arange(1000) / 100.0)
    inside = slice(100, -100)
    assert np.mean(log.motion.v[inside] <= 0.0) == pytest.approx(backwards, abs=0.1)
    hidden = direction_hidden(log, np.array([2 * np.pi / 4096]))[inside]
    assert hidden.all() if backwards else not hidden.any()


def test_a_joint_that_turns_or_starts_hides_nothing(pendulum):
    t = np.arange(2000) / 100.0
    for q in (0.3 * np.sin(2.0 * t), np.maximum(t - 10.0, 0.0) * 0.3):
        hidden = direction_hidden(read_coarsely(pendulum, q), np.array([2 * np.pi / 4096]))
        assert not hidden[t > 10.0].any()


def test_standing_friction_is_evenly_anywhere_up_to_breakaway():
    # Monte Carlo of the sentence: the model says +T or -T, the truth is anything between.
    rng, log = np.random.default_rng(0), log_of(stopping())
    stands = np.ones((len(T), 1), dtype=bool)
    doubt = standstill_std(log, stands, 0.3 * np.sign(rng.normal(size=(len(T), 1))))
    apart = rng.uniform(-0.3, 0.3, 100_000) - 0.3 * rng.choice([-1, 1], 100_000)
    np.testing.assert_allclose(doubt, apart.std(), rtol=0.01)


@pytest.mark.parametrize(("stop", "left", "holds"), [(0.04, -0.9, True), (0.04, -0.19, False), (1.0, -0.9, False)])
def test_a_short_stop_may_hold_a_residual_that_is_larger_than_in_motion(pendulum, stop, left, holds):
    # By hand: the model leaves 0.1 N m in motion. A long stop is left out anyway, and no fit uses it.
    log = log_of(0.5 * (np.minimum(T, 2.0) + np.maximum(T - 2.0 - stop, 0.0)))
    t = T[log.samples]
    residual = np.where((t >= 1.95) & (t <= 2.05 + stop), left, 0.1)[:, None]
    held = held_std(pendulum, log, residual)[:, 0]
    middle = held[np.argmin(np.abs(t - 2.0 - stop / 2))]
    share = np.abs(log.band.kernel)[log.band.half - 20 : log.band.half + 21].sum() if holds else 0.0
    assert middle == pytest.approx(abs(left) * share, rel=0.2)
    assert not held[(t < 1.93) | (t > 2.07 + stop)].any()


def test_what_standing_leaves_open_reaches_as_far_as_the_filter():
    log = log_of(stopping())
    stands = ((T >= 1.0) & (T <= 2.0))[:, None]
    doubt = standstill_std(log, stands, np.full((len(T), 1), 0.3))[:, 0]
    t = T[log.samples]
    np.testing.assert_allclose(doubt[(t > 1.06) & (t < 1.94)], np.sqrt(4 / 3) * 0.3, rtol=1e-9)
    assert doubt[np.argmin(np.abs(t - 1.0))] == pytest.approx(np.sqrt(4 / 3) * 0.15, rel=0.1)
    assert not doubt[(t < 0.945) | (t > 2.055)].any()


def test_friction_is_in_doubt_by_three_tenths_near_a_reversal_and_below_a_twentieth_of_the_top_speed():
    # By hand: cos(t) turns at pi, within asin(0.05) of it, or 50 ms where that is longer, and as far as the filter.
    log = log_of(np.cos(T * np.pi / 2.0))
    doubt = creeping_std(log, np.full((len(T), 1), 0.4))[:, 0]
    t, creeps = T[log.samples], max(np.arcsin(0.05) * 2.0 / np.pi, 0.05)
    reach = log.band.half / log.band.rate_hz
    np.testing.assert_array_equal(doubt[np.abs(t - 2.0) > creeps + reach + 0.01][20:-20] == 0.0, True)
    assert doubt[np.argmin(np.abs(t - 2.0))] > 0.1
    assert doubt.max() <= 0.3 * 0.4 * np.abs(log.band.kernel).sum() * (1.0 + 1e-9)


def test_doubts_about_friction_add_as_variances(pendulum):
    log, friction = log_of(stopping()), np.full((len(T), 1), 0.3)
    doubt = np.full((len(log.samples), 1), 0.02)
    stands = standstill_std(log, encoder_still(pendulum, log), friction)
    expected = stands**2 + 0.02**2 + creeping_std(log, friction) ** 2
    np.testing.assert_allclose(uncertain_friction_variance(pendulum, log, friction, doubt), expected)


def test_friction_counts_findings_that_rub_and_nothing_else(pendulum):
    robot = replace(pendulum, coulomb_friction=np.array([0.2]), viscous_friction=np.zeros(1))
    operation = Operation.of(robot, log_of(stopping()).motion)
    (joint,) = robot.joint_names
    found = tuple(
        FoundEffect(effect_named(name), joint, (), np.array([0.5])) for name in ("coulomb_friction", "torque_offset")
    )
    moving = (T < 0.99) | (T > 2.01)
    np.testing.assert_allclose(friction_torque_with(operation, found)[moving], 0.7, atol=1e-9)


def test_a_reversal_is_near_for_fifty_milliseconds():
    log = log_of(np.sin(np.pi * T))
    near, t = near_reversals(log)[:, 0], T[log.samples]
    turns = np.array([0.5, 1.5, 2.5, 3.5])
    apart = np.abs(t[:, None] - turns).min(axis=1)
    assert near[apart < 0.045].all()
    assert not near[apart > 0.055].any()


def test_a_coarse_encoder_stands_where_it_stays_for_longer(pendulum):
    # By hand: 2.2 steps of 5 mrad at an eighth of a radian per second take 88 ms; the joint stands for a second.
    stands = encoder_still(pendulum, log_of(stopping(), step=0.005))[:, 0]
    assert stands[(T >= 1.05) & (T <= 1.95)].all()
    assert not stands[(T < 0.9) | (T > 2.1)].any()


def test_readings_at_uneven_times_stand_where_they_stood_before_they_were_made_even(pendulum):
    # Known truth: a joint that stops for a second, read with a flicker of one count at times that jitter by a quarter.
    rng = np.random.default_rng(5)
    t = np.sort(T + rng.uniform(-0.25, 0.25, len(T)) / RATE)
    q = np.interp(t, T, stopping()) + 0.3 * STEP * rng.normal(size=len(t))
    read = np.round(q / STEP) * STEP
    torque = np.sin(7.0 * t) + 0.01 * rng.normal(size=len(t))
    log = process(Recording("a.csv", ("pin",), t, read[:, None], torque[:, None]), pendulum, cutoff_hz=20.0)
    stands = encoder_still(pendulum, log)[:, 0]
    assert log.reading_steps == pytest.approx((STEP,), rel=1e-2)
    assert stands[(log.motion.t >= 1.02) & (log.motion.t <= 1.98)].mean() > 0.95
    assert not stands[(log.motion.t < 0.99) | (log.motion.t > 2.01)].any()
