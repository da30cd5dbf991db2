from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.judge.regimes import regime_shares, regimes


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
