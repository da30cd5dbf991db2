"""Events that nobody measured. Oracle: known truth, pushes put into noise and into simulated recordings."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.data.drives.joint_torque import external_torque
from identification.diagnosis.judge.bursts import burst_notes, bursts_in, distinct_bursts
from identification.diagnosis.result import Burst, JointGap
from identification.pipeline import diagnose
from identification.words.note_words import sentences

T = np.arange(0, 30, 0.02)
EXPECTED = np.full((len(T), 2), 0.05)
ALL = np.ones((len(T), 2), dtype=bool)
JOINTS = ("shoulder", "elbow")


def noise(seed: int = 0) -> np.ndarray:
    return 0.05 * np.random.default_rng(seed).standard_normal((len(T), 2))


def test_a_push_is_found_with_joint_times_torque_and_size():
    left = noise()
    left[:, 1] += 1.5 * ((T > 12) & (T < 12.6))
    ((joint, start, stop, torque, ratio),) = bursts_in(T, left, EXPECTED, ALL, JOINTS)
    assert joint == "elbow"
    assert (start, stop) == (pytest.approx(12, abs=0.1), pytest.approx(12.6, abs=0.1))
    assert torque == pytest.approx(1.5, abs=0.2)
    assert ratio == pytest.approx(30, rel=0.1)


def test_pushes_both_ways_that_fill_a_quarter_of_the_time_are_found_one_by_one():
    left, starts = noise(), np.array([2.0, 6.0, 11.0, 15.0, 21.0, 26.0])
    for start, side in zip(starts, [1, -1, -1, 1, 1, -1], strict=True):
        left[:, 0] += 0.6 * side * np.sin(np.pi * np.clip((T - start) / 1.2, 0, 1))
    found = bursts_in(T, left, EXPECTED, ALL, JOINTS)
    assert [np.sign(torque) for _, _, _, torque, _ in found] == [1, -1, -1, 1, 1, -1]
    np.testing.assert_allclose([(start + stop) / 2 for _, start, stop, _, _ in found], starts + 0.6, atol=0.1)


def test_a_push_that_two_joints_feel_is_said_once_for_the_one_that_shows_it_best():
    left = noise() + np.array([2.0, 1.0]) * ((T > 5) & (T < 5.5))[:, None]
    assert [joint for joint, *_ in bursts_in(T, left, EXPECTED, ALL, JOINTS)] == ["shoulder"]
    assert [joint for joint, *_ in bursts_in(T, left, EXPECTED * [4.0, 1.0], ALL, JOINTS)] == ["elbow"]


@pytest.mark.parametrize("before", [0.0, 0.98, -0.9])
def test_noise_of_any_colour_is_no_event(before):
    for seed in range(50):
        left = np.asarray(lfilter([1.0], [1.0, -before], noise(seed), axis=0))
        assert bursts_in(T, left, np.full_like(left, left.std()), ALL, JOINTS) == ()


def test_slow_noise_is_judged_by_its_own_levels_and_not_as_if_it_were_white():
    # The same events, once in white noise, once in noise whose levels over a second are as large as they are.
    push = np.stack([0.35 * ((T > 12) & (T < 13)), 0.0 * T], axis=1)
    slow = 0.05 * np.sin(2 * np.pi * 0.31 * T + np.array([[0.0], [1.0]])).T * np.sqrt(2)
    assert len(bursts_in(T, noise() + push, EXPECTED, ALL, JOINTS)) == 1
    assert bursts_in(T, 5 * slow + 0.6 * push, EXPECTED, ALL, JOINTS) == ()


def test_what_was_expected_at_that_moment_is_no_event():
    left, expected = noise(), EXPECTED.copy()
    here = (T > 12) & (T < 12.6)
    left[here, 1] += 1.5
    expected[here] = 0.5
    assert bursts_in(T, left, expected, ALL, JOINTS) == ()


def test_samples_that_may_not_be_used_are_no_event():
    left, usable = noise(), ALL.copy()
    here = (T > 12) & (T < 12.6)
    left[:, 1] += 1.5 * here
    usable[:, 1] = ~here
    assert bursts_in(T, left, EXPECTED, usable, JOINTS) == ()


def test_few_samples_have_no_event():
    assert bursts_in(T[:10], 9 * noise()[:10], EXPECTED[:10], ALL[:10], JOINTS) == ()


def test_a_burst_is_reported_with_what_to_leave_out():
    burst = Burst("a.csv", "elbow", 3.0, 3.5, -1.25, 12.0)
    (sentence,) = sentences(burst_notes((burst,), (JointGap("elbow", "N m", 1.0, 1.0, 0.1, 100),)))
    assert sentence.startswith(
        "a.csv: from 3.00 to 3.50 s a torque of up to -1.25 N m acts on joint elbow that neither the model nor a "
        "finding explains:"
    )
    assert "--exclude 2.80:3.70," in sentence


@pytest.fixture(scope="module")
def pushed(lab, planar2):
    """A recording in which the last link is pushed for half a second, and the force."""
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    force = np.zeros((len(motion.t), 3))
    force[:, 0] = 8.0 * ((motion.t > 12.0) & (motion.t < 12.5))
    torque = external_torque(planar2, motion.q, {"lower": force})
    return lab.recording(planar2, motion, torque), force


def test_a_push_that_nobody_measured_is_reported_with_its_torque_and_what_to_leave_out(planar2, pushed):
    # Known truth: from 12 to 12.5 s.
    recording, force = pushed
    (said,) = (w for w in sentences(diagnose(planar2, (recording,)).data_warnings) if "neither the model nor" in w)
    start, stop, torque = map(
        float, re.findall(r"from ([\d.]+) to ([\d.]+) s a torque of up to ([-\d.]+) N m", said)[0]
    )
    assert "acts on joint shoulder that neither the model nor a finding explains" in said
    assert 11.8 < start < 12.1 < 12.4 < stop < 12.7
    given = external_torque(planar2, recording.q, {"lower": force})[:, 0]
    assert torque == pytest.approx(given[np.argmax(np.abs(given))], rel=0.25)
    out = map(float, re.findall(r"--exclude ([\d.]+):([\d.]+),", said)[0])
    assert list(out) == pytest.approx([start - 0.2, stop + 0.2])


def test_a_push_that_is_left_out_is_no_gap(planar2, pushed):
    found = diagnose(planar2, (replace(pushed[0], excluded=((11.7, 12.8),)),))
    assert (found.verdict, found.data_warnings) == ("no_gap", ())


def test_a_push_that_was_measured_is_no_gap(planar2, pushed):
    recording, force = pushed
    found = diagnose(planar2, (replace(recording, forces={"lower": force}),))
    assert (found.verdict, found.data_warnings) == ("no_gap", ())


def test_a_hole_in_a_recording_is_no_event(planar2, lacking):
    whole = lacking(("coulomb_friction", "elbow", (0.8,)), seed=4)
    kept = (whole.t < 9.0) | (whole.t > 11.0)
    found = diagnose(planar2, (replace(whole, t=whole.t[kept], q=whole.q[kept], tau=whole.tau[kept]),))
    assert (found.verdict, found.data_warnings) == ("explained", ())
    # Of the noise that was put in, there is as much beside the hole as elsewhere.
    assert all(joint.rms_after < 1.05 * joint.noise_floor_interval[1] for joint in found.joints)


@pytest.mark.parametrize(
    ("elsewhere", "joint", "torque", "said"),
    [
        # Oracle: the rule by hand. The floor is 1 N m on both joints; the burst is left out of the rest.
        (1.0, "elbow", 4.0, True),
        (1.0, "shoulder", 4.0, True),
        # The shoulder is loud: its events are six times as large as the rest.
        (3.0, "shoulder", 17.0, False),
        (3.0, "shoulder", 19.0, True),
        (3.0, "elbow", 2.9, False),
        (3.0, "elbow", 3.1, True),
    ],
)
def test_a_burst_stands_out_from_a_quiet_rest(quiet, elsewhere, joint, torque, said):
    log = quiet.logs[0]
    residual = np.ones((len(log.samples), 2)) * [elsewhere, 1.0]
    t = log.motion.t[log.samples]
    residual[(t > 2.0) & (t < 2.2)] = 50.0
    burst = Burst(log.file, joint, 2.0, 2.2, torque, 5.0)
    assert distinct_bursts((burst,), quiet.problem, (residual,), np.ones(2)) == ((burst,) if said else ())
