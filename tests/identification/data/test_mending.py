"""What is mended of a recording. Oracle: known truth; jumps, spikes and dropouts are put into a clean recording."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from identification.data.mending import mended, spikes, whole_turns
from identification.data.recording import Recording

T = np.arange(4000) / 500
TURNING, SLIDING = np.array([False]), np.array([True])


@pytest.fixture
def swinging(rng) -> Recording:
    """One joint that swings by three turns, with noise on its torque."""
    q = 9.0 * np.sin(2 * np.pi * 0.2 * T)[:, None]
    tau = np.sin(2 * np.pi * 0.7 * T)[:, None] + 0.02 * rng.standard_normal((len(T), 1))
    return Recording("a.csv", ("pin",), T, q, tau, q_ref=q + 0.01)


def wrapped(q: np.ndarray) -> np.ndarray:
    """An encoder that counts from -pi to pi."""
    return np.mod(q + np.pi, 2 * np.pi) - np.pi


def test_a_clean_recording_stays_as_it_is(swinging):
    assert mended(swinging, TURNING) is swinging


def test_the_turns_of_an_encoder_are_put_together(swinging):
    found = mended(replace(swinging, q=wrapped(swinging.q)), TURNING)
    np.testing.assert_allclose(found.q, swinging.q, atol=1e-12)
    # 9 sin(x) crosses pi and minus pi seven times in 1.6 periods, and no other odd multiple of pi.
    assert re.search(r"q of pin jumps by whole turns 7 times .*its turns were put together", found.warnings[0])


def test_a_reference_that_was_wrapped_too_goes_along(swinging):
    found = mended(replace(swinging, q=wrapped(swinging.q), q_ref=wrapped(swinging.q_ref)), TURNING)
    np.testing.assert_allclose(found.q_ref, swinging.q_ref, atol=1e-12)


def test_a_reference_that_was_not_wrapped_stays(swinging):
    found = mended(replace(swinging, q=wrapped(swinging.q)), TURNING)
    np.testing.assert_allclose(found.q_ref, swinging.q_ref, atol=1e-12)


def test_a_linear_joint_has_no_turns(swinging):
    far = replace(swinging, q=wrapped(swinging.q))
    assert mended(far, SLIDING) is far


def test_positions_in_degrees_have_no_turns_put_together(swinging):
    # Some 360 degrees a second: steps from sample to sample reach a whole number that looks like turns.
    q = np.rad2deg(9.0 * np.sin(2 * np.pi * 2.0 * T))
    assert np.abs(np.diff(q)).max() > 2 * np.pi
    assert len(whole_turns(q)[1]) == 0


@pytest.mark.parametrize("samples", [1, 3, 5])
@pytest.mark.parametrize("quantity", ["q", "tau"])
def test_a_spike_is_cut_out_and_told_with_its_time(swinging, quantity, samples):
    broken = getattr(swinging, quantity).copy()
    broken[1000 : 1000 + samples] += 1.5
    found = mended(replace(swinging, **{quantity: broken}), TURNING)
    np.testing.assert_allclose(getattr(found, quantity), getattr(swinging, quantity), atol=0.1)
    told = rf"1 spike or dropout of {samples} samples? in all \(at t = 2 s\): it was cut out"
    assert re.search(told, found.warnings[0])


def test_a_dropout_to_zero_is_cut_out(swinging):
    broken = swinging.tau.copy()
    k = int(np.argmax(broken[:, 0] > 0.9))
    broken[k + 5 : k + 8] = 0.0
    assert mended(replace(swinging, tau=broken), TURNING).tau[k + 6, 0] > 0.8


def test_a_step_that_stays_is_no_spike(swinging):
    stepped = swinging.tau.copy()
    stepped[1000:] += 3.0
    assert spikes(stepped[:, 0], 0.1) == []


def test_friction_that_changes_sign_is_no_spike():
    v = np.cos(2 * np.pi * 3.0 * T)
    assert spikes(np.sign(v) + 0.1 * v, 0.1) == []


def test_a_recording_full_of_dropouts_stays_as_it_is(swinging):
    # Two samples in a hundred are no accident.
    broken = swinging.q.copy()
    for start in range(100, 3900, 240):
        broken[start : start + 5] += 2.0
    recording = replace(swinging, q=broken)
    assert len(spikes(broken[:, 0], 0.02)) == 16
    assert mended(recording, TURNING) is recording


@pytest.fixture
def stepping() -> Recording:
    """A joint that every second is kicked from rest to 2 rad/s within 3 ms, and slows down in 0.3 s."""
    t = np.arange(6000) / 1000
    after, kicks = t % 1.0, t > 0.5
    v = np.where(kicks, 2.0 * np.clip(1.0 - after / 0.3, 0.0, 1.0) * np.minimum(after / 0.003, 1.0), 0.0)
    tau = np.where(kicks & (after < 0.003), 100.0, np.where(kicks & (after < 0.3), -1.0, 0.0))
    return Recording("a.csv", ("pin",), t, np.cumsum(v)[:, None] / 1000, tau[:, None])


def test_a_torque_with_which_the_velocity_jumps_is_no_spike(stepping):
    assert len(spikes(stepping.tau[:, 0], 1.0)) == 5
    assert mended(stepping, TURNING) is stepping


def test_a_spike_without_a_jump_is_cut_out_beside_torques_that_make_one(stepping):
    broken = stepping.tau.copy()
    broken[2700:2702] = 100.0
    found = mended(replace(stepping, tau=broken), TURNING)
    np.testing.assert_allclose(found.tau, stepping.tau)
    assert "1 spike or dropout of 2 samples in all (at t = 2.7 s)" in found.warnings[0]
