from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.diagnosis.judge.regimes import regime_shares, regime_split, regimes
from phantom_dyn.motion import Motion


def shares(quiet, residual: np.ndarray) -> tuple[dict[str, float], str]:
    full = np.zeros_like(quiet.columns.residual[0])
    full[:, 1] = residual
    return regime_shares(quiet.problem, (full,), 1)


def motion_of(quiet) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    log = quiet.logs[0]
    at = log.samples
    return log.motion.t[at], log.motion.v[at, 1], log.motion.a[at, 1]


def test_a_residual_around_reversals_is_named_so(quiet):
    near = regimes(quiet.logs[0], quiet.columns, 0, 1)["velocity_reversal"]
    found, best = shares(quiet, near.astype(float))
    assert best == "velocity_reversal"
    assert found["velocity_reversal"] == 1.0


def test_a_residual_at_high_speed_is_named_so(quiet):
    _, v, _ = motion_of(quiet)
    found, best = shares(quiet, np.abs(v) ** 4)
    assert best == "high_speed"
    assert found["high_speed"] > 0.8


def test_a_residual_that_is_the_same_everywhere_has_no_regime(quiet):
    _, best = shares(quiet, np.ones(len(quiet.logs[0].samples)))
    assert best == "everywhere"


def test_the_direction_with_the_larger_residual_is_counted(quiet):
    _, v, _ = motion_of(quiet)
    for sign in (1.0, -1.0):
        found, best = shares(quiet, (sign * v > 0).astype(float))
        assert best == "one_direction"
        assert found["one_direction"] == pytest.approx(1.0)


def test_the_half_of_the_record_with_the_larger_residual_is_counted(quiet):
    t, _, _ = motion_of(quiet)
    for late in (True, False):
        found, best = shares(quiet, ((t > t.mean()) == late).astype(float))
        assert best == "time_drift"
        assert found["time_drift"] > 0.95


def test_no_residual_has_no_regime(quiet):
    found, best = shares(quiet, np.zeros(len(quiet.logs[0].samples)))
    assert best == "everywhere"
    assert not any(found.values())


@pytest.mark.parametrize("usable", [True, False])
def test_nothing_that_is_left_takes_no_time(quiet, usable):
    columns = replace(quiet.columns, usable=(np.full_like(quiet.columns.usable[0], usable),))
    residual = np.zeros_like(columns.residual[0]) if usable else np.ones_like(columns.residual[0])
    split = regime_split(replace(quiet.problem, columns=columns), (residual,), 1)
    assert split.best == "everywhere"
    assert set(split.times) == set(split.shares) == set(regimes(quiet.logs[0], columns, 0, 1))
    assert set(split.times.values()) == set(split.shares.values()) == {0.0}


def test_reversals_are_where_the_velocity_changes_sign(quiet):
    # Brute force: a zero crossing within the reach of the filter, and 50 ms at least.
    log = quiet.logs[0]
    near = regimes(log, quiet.columns, 0, 1)["velocity_reversal"]
    v = log.motion.v[:, 1]
    crossings = np.flatnonzero(np.sign(v[1:]) != np.sign(v[:-1])) + 1
    reach = max(int(0.05 * log.band.rate_hz), log.band.half // 2, 1)
    expected = [np.abs(crossings - k).min() <= reach for k in log.samples]
    np.testing.assert_array_equal(near, expected)


def test_regimes_of_speed_do_not_overlap(quiet):
    found = regimes(quiet.logs[0], quiet.columns, 0, 1)
    assert not np.any(found["low_speed"] & found["high_speed"])
    assert not np.any(found["low_speed"] & found["velocity_reversal"])


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


@pytest.mark.parametrize(("energy", "best"), [(2.3, "everywhere"), (2.5, "high_load")])
def test_a_regime_is_named_that_holds_half_as_much_again_as_its_time(quiet, energy, best):
    # Closed form: a share of p = 43 % of the time at s times the energy holds p s / (p s + 1 - p) of it, 1.5 p at 2.41.
    load = np.roll(np.linspace(0.0, 1.0, 2000), 1000)
    log, columns = unfiltered(quiet, np.ones(2000), np.ones(2000), load)
    problem = replace(
        quiet.problem,
        columns=replace(columns, usable=(np.ones((2000, 2), dtype=bool),)),
        session=replace(quiet.session, logs=(log,)),
    )
    residual = np.where(load > 0.57, np.sqrt(energy), 1.0)[:, None] * np.ones(2)
    found = regime_split(problem, (residual,), 1)
    assert found.times["high_load"] == pytest.approx(0.43, abs=1e-3)
    assert found.best == best


def test_a_regime_of_less_than_a_fiftieth_of_the_time_is_not_named(quiet):
    # By hand: one reversal in 2000 samples takes eleven of them.
    v = np.where(np.arange(2000) < 1000, 1.0, -1.0)
    log, columns = unfiltered(quiet, v, np.ones(2000), np.ones(2000))
    problem = replace(
        quiet.problem,
        columns=replace(columns, usable=(np.ones((2000, 2), dtype=bool),)),
        session=replace(quiet.session, logs=(log,)),
    )
    near = np.abs(np.arange(2000) - 1000) <= 5
    found = regime_split(problem, (near.astype(float)[:, None] * np.ones(2),), 1)
    assert found.shares["velocity_reversal"] == 1.0
    assert found.times["velocity_reversal"] == pytest.approx(11 / 2000)
    assert found.best != "velocity_reversal"
