from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.diagnosis.judge.regimes import regime_split, regimes
from phantom_dyn.motion import Motion


@pytest.mark.parametrize("name", ["one_direction", "time_drift"])
@pytest.mark.parametrize("first", [True, False])
def test_of_two_directions_and_of_two_halves_the_one_with_the_larger_residual_is_counted(quiet, name, first):
    # Known truth: the residual is there in one of the two and nowhere else.
    there = regimes(quiet.logs[0], quiet.columns, 0, 1)[name] == first
    split = regime_split(quiet.problem, (there.astype(float)[:, None] * np.ones(2),), 1)
    assert (split.best, split.shares[name]) == (name, pytest.approx(1.0))


@pytest.mark.parametrize("usable", [True, False])
def test_nothing_that_is_left_takes_no_time(quiet, usable):
    columns = replace(quiet.columns, usable=(np.full_like(quiet.columns.usable[0], usable),))
    residual = np.zeros_like(columns.residual[0]) if usable else np.ones_like(columns.residual[0])
    split = regime_split(replace(quiet.problem, columns=columns), (residual,), 1)
    assert split.best == "everywhere"
    assert set(split.times) == set(split.shares) == set(regimes(quiet.logs[0], columns, 0, 1))
    assert set(split.times.values()) == set(split.shares.values()) == {0.0}


RATE = 100.0


def unfiltered(quiet, v: np.ndarray, a: np.ndarray, load: np.ndarray, *, half: int = 0):
    """A log of the elbow with known speeds, accelerations and loads, and the columns that go with it."""
    count = len(v)
    states = np.zeros((3, count, 2))
    states[1, :, 1], states[2, :, 1] = v, a
    band = Band(RATE, 20.0, np.ones(2 * half + 1) / (2 * half + 1), 1)
    motion = Motion(np.arange(count) / RATE, *states)
    log = Log("by hand", quiet.logs[0].joint_names, motion, np.zeros((count, 2)), band, np.ones(count, dtype=bool))
    torque = np.zeros((count - 2 * half, 2))
    torque[:, 1] = load[half : count - half]
    return log, replace(quiet.columns, model_torque=(torque,))


def test_levels_of_speed_load_and_acceleration_are_shares_of_what_one_in_twenty_exceeds(quiet):
    # By hand: each goes evenly from 0 to 1 either way, 0.95 at 95 %: low below 0.2375, high above 0.57.
    ramp = np.linspace(0.0, 1.0, 2000)
    found = regimes(*unfiltered(quiet, ramp[::-1].copy() + 1e-9, -ramp, np.roll(ramp, 500)), 0, 1)
    np.testing.assert_array_equal(found["high_speed"], ramp[::-1] > 0.57)
    np.testing.assert_array_equal(found["low_speed"], ramp[::-1] < 0.2375)
    np.testing.assert_array_equal(found["high_acceleration"], ramp > 0.57)
    np.testing.assert_array_equal(found["high_load"], np.roll(ramp, 500) > 0.57)


def test_the_second_half_of_a_record_is_where_half_of_its_time_has_passed(quiet):
    one = np.ones(1001)
    found = regimes(*unfiltered(quiet, one, one, one), 0, 1)["time_drift"]
    np.testing.assert_array_equal(found, np.arange(1001) > 500)


def test_one_direction_is_forwards(quiet):
    v = np.tile([1.0, 1.0, -1.0, 0.0], 50)
    np.testing.assert_array_equal(regimes(*unfiltered(quiet, v, v, v), 0, 1)["one_direction"], v > 0)


@pytest.mark.parametrize(("half", "reach"), [(0, 5), (11, 5), (12, 6), (40, 20)])
def test_a_reversal_reaches_over_half_a_kernel_and_fifty_milliseconds_at_least(quiet, half, reach):
    # By hand: at 100 Hz the velocity changes its sign at sample 100.
    v = np.where(np.arange(201) < 100, 1.0, -1.0)
    near = regimes(*unfiltered(quiet, v, v, v, half=half), 0, 1)["velocity_reversal"]
    np.testing.assert_array_equal(near, np.abs(np.arange(half, 201 - half) - 100) <= reach)


def test_what_is_near_a_reversal_is_no_low_speed(quiet):
    v = np.interp(np.arange(201), [0, 200], [1.0, -1.0]) + 1e-9
    found = regimes(*unfiltered(quiet, v, v, v), 0, 1)
    np.testing.assert_array_equal(found["low_speed"], (np.abs(v) < 0.25 * 0.95) & ~found["velocity_reversal"])
    assert found["low_speed"].sum() > 10


def test_shares_are_of_the_energy_and_of_the_time_of_usable_samples_of_all_recordings(quiet):
    # By hand: two records of the same motion, a quarter of which cannot be used; a residual of 1, and 3 at high speed.
    log, columns = unfiltered(quiet, np.linspace(0.01, 1.0, 1000), np.ones(1000), np.ones(1000))
    fast = log.motion.v[:, 1] > 0.6 * np.percentile(log.motion.v[:, 1], 95)
    usable = np.ones((1000, 2), dtype=bool)
    usable[::4, 1] = False
    both = replace(columns, model_torque=2 * columns.model_torque, usable=(usable, np.ones_like(usable)))
    problem = replace(quiet.problem, columns=both, session=replace(quiet.session, logs=(log, log)))
    residual = np.where(fast, 3.0, 1.0)[:, None] * np.ones(2)
    split = regime_split(problem, (residual, residual), 1)
    energy = [9.0 * (fast & use[:, 1]).sum() for use in both.usable]
    whole = sum(energy) + sum((~fast & use[:, 1]).sum() for use in both.usable)
    assert split.shares["high_speed"] == pytest.approx(sum(energy) / whole)
    assert split.times["high_speed"] == pytest.approx(sum((fast & use[:, 1]).sum() for use in both.usable) / 1750)
    assert split.best == "high_speed"


def judged(quiet, v: np.ndarray, load: np.ndarray):
    """A problem of such a log alone, of which every sample may be used."""
    log, columns = unfiltered(quiet, v, np.ones(len(v)), load)
    columns = replace(columns, usable=(np.ones((len(v), 2), dtype=bool),))
    return replace(quiet.problem, columns=columns, session=replace(quiet.session, logs=(log,)))


@pytest.mark.parametrize(("energy", "best"), [(2.3, "everywhere"), (2.5, "high_load")])
def test_a_regime_is_named_that_holds_half_as_much_again_as_its_time(quiet, energy, best):
    # Closed form: a share of p = 43 % of the time at s times the energy holds p s / (p s + 1 - p) of it, 1.5 p at 2.41.
    load = np.roll(np.linspace(0.0, 1.0, 2000), 1000)
    problem = judged(quiet, np.ones(2000), load)
    residual = np.where(load > 0.57, np.sqrt(energy), 1.0)[:, None] * np.ones(2)
    found = regime_split(problem, (residual,), 1)
    assert found.times["high_load"] == pytest.approx(0.43, abs=1e-3)
    assert found.best == best


def test_a_regime_of_less_than_a_fiftieth_of_the_time_is_not_named(quiet):
    # By hand: one reversal in 2000 samples takes eleven of them.
    v = np.where(np.arange(2000) < 1000, 1.0, -1.0)
    problem = judged(quiet, v, np.ones(2000))
    near = np.abs(np.arange(2000) - 1000) <= 5
    found = regime_split(problem, (near.astype(float)[:, None] * np.ones(2),), 1)
    assert found.shares["velocity_reversal"] == 1.0
    assert found.times["velocity_reversal"] == pytest.approx(11 / 2000)
    assert found.best != "velocity_reversal"
