from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.motion.standstill import reversal_doubt
from identification.diagnosis.noise.whitening import filtered, noise_filter, whitened, whitened_noise
from identification.pipeline import diagnose
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion


def test_doubt_is_the_rate_of_modelled_coulomb_friction_times_five_milliseconds(lab, pendulum):
    # Closed form: T sign(v) jumps by 2 T at every reversal, between two samples; viscous friction does not count.
    robot = replace(pendulum, coulomb_friction=np.array([0.4]), viscous_friction=np.array([2.0]))
    motion = lab.motion(1)
    doubt = reversal_doubt(Operation.of(robot, motion))
    expected = 0.005 * np.gradient(0.4 * np.sign(motion.v), motion.t, axis=0)
    np.testing.assert_allclose(doubt, expected, atol=1e-9)


def test_a_model_without_coulomb_friction_is_not_doubted(lab, pendulum):
    robot = replace(pendulum, coulomb_friction=np.zeros(1), viscous_friction=np.array([2.0]))
    np.testing.assert_allclose(reversal_doubt(Operation.of(robot, lab.motion(1))), 0.0, atol=1e-12)


def test_samples_in_doubt_count_as_if_their_noise_were_larger_by_it(quiet, rng):
    # Brute force: each whitened sample times the share of noise in noise and doubt, of mean square one.
    columns = quiet.columns
    noise = (np.where(columns.usable[0], rng.normal(size=columns.residual[0].shape), 0.0),)
    doubt = (3.0 * rng.random(columns.residual[0].shape),)
    plain, _ = whitened(replace(columns, doubt=(np.zeros_like(doubt[0]),)), noise)
    white, _ = whitened(replace(columns, doubt=doubt), noise)
    for j in range(2):
        kernel, use = noise_filter([noise[0][:, j]]), columns.usable[0][:, j]
        variance = np.mean(filtered(kernel, noise[0][:, j])[use] ** 2)
        share = variance / (variance + filtered(kernel, doubt[0][:, j]) ** 2)
        expected = plain.residual[0][:, j] * np.sqrt(share / share[use].mean())
        np.testing.assert_allclose(white.residual[0][:, j], expected, rtol=1e-9)


def test_what_standing_joints_leave_open_counts_at_the_most_that_the_filter_makes_of_it(quiet, rng):
    # Brute force: the sum over the filter's weights without their signs.
    columns = quiet.columns
    noise = (np.where(columns.usable[0], rng.normal(size=columns.residual[0].shape), 0.0),)
    standing = (3.0 * rng.random(columns.residual[0].shape) * (rng.random(columns.residual[0].shape) < 0.2),)
    none = (np.zeros_like(standing[0]),)
    plain, _ = whitened(replace(columns, doubt=none, standing=none), noise)
    white, _ = whitened(replace(columns, doubt=none, standing=standing), noise)
    for j in range(2):
        kernel, use = noise_filter([noise[0][:, j]]), columns.usable[0][:, j]
        variance = np.mean(filtered(kernel, noise[0][:, j])[use] ** 2)
        share = variance / (variance + filtered(np.abs(kernel), standing[0][:, j]) ** 2)
        expected = plain.residual[0][:, j] * np.sqrt(share / share[use].mean())
        np.testing.assert_allclose(white.residual[0][:, j], expected, rtol=1e-9)


def test_columns_and_noise_count_as_the_residual_does(quiet, rng):
    columns = quiet.columns
    noise = (np.where(columns.usable[0], rng.normal(size=columns.residual[0].shape), 0.0),)
    doubted = replace(columns, doubt=(rng.random(columns.residual[0].shape),), residual=noise)
    same = tuple(tuple(np.repeat(noise[0][:, [j]], 2, axis=1) for j in range(2)) for _ in range(1))
    white, white_noise = whitened(replace(doubted, values=same), noise)
    np.testing.assert_allclose(white.residual[0], white_noise[0])
    np.testing.assert_allclose(white.values[0][1][:, 1], white_noise[0][:, 1])
    np.testing.assert_allclose(whitened_noise(doubted, noise, like=noise)[0], white_noise[0])


def test_friction_that_passes_through_zero_two_milliseconds_late_is_no_certain_finding(lab, pendulum):
    # Known truth: nothing but the modelled friction, in steps that come later; noise of a hundredth of it.
    robot = replace(pendulum, coulomb_friction=np.array([0.5]))
    motion = lab.motion(1, 1, seconds=20.0, rate=500.0)
    late = lab.motion(1, 1, seconds=20.0, rate=500.0, ahead=-0.002)
    torque = 0.5 * (np.sign(motion.v) - np.sign(late.v))
    recording = replace(lab.recording(robot, motion, torque, noise=0.005), q=motion.q)
    for finding in diagnose(robot, (recording,)).findings:
        # The lateness that it is has to be among its rivals, and as likely.
        assert finding.probability <= 0.5
        assert any(one.effect == "input_delay" for rival in finding.rivals for one in rival.effects)


def test_a_drive_that_is_late_is_still_found_beside_modelled_friction(lab, pendulum):
    # Known truth: all of the torque ten milliseconds late.
    robot = replace(pendulum, coulomb_friction=np.array([0.5]))
    motion = lab.motion(1, seconds=20.0, rate=500.0)
    late = lab.motion(1, seconds=20.0, rate=500.0, ahead=0.010)
    recording = lab.recording(robot, motion, noise=0.02)
    asked = lab.recording(robot, Motion(motion.t, late.q, late.v, late.a), noise=0.02).tau
    found = diagnose(robot, (replace(recording, tau=asked),)).findings
    assert [finding.effect for finding in found] == ["input_delay"]
