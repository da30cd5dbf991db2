"""Torques that stay the same while their joint moves; known truth: the rows that the test has overwritten."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import phantom_dyn as dyn
from identification.data.checks.check_recording import check_recording
from identification.data.checks.times_and_torques import check_flat
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS


@pytest.mark.parametrize(("value", "said"), [(0.0, "is 0 in every row from 4"), (2.5, "is 2.5 in every row from 4")])
def test_a_torque_that_stays_the_same_in_most_rows_is_named_with_the_stretch_to_leave_out(clean, arm, value, said):
    recording = clean(rate=200.0)
    tau = recording.tau.copy()
    tau[recording.t >= 4.0, 1] = value
    (sentence,) = check_flat(replace(recording, tau=tau))
    assert f"tau.{arm.joint_names[1]} {said} to 19.995 s (80 % of the rows)" in sentence
    assert sentence.endswith("--exclude 4:19.995.")
    assert sentence in check_recording(replace(recording, tau=tau), arm)


def test_a_torque_that_stays_the_same_at_rest_or_for_a_short_time_is_no_fault(clean):
    recording = clean(rate=200.0)
    tau, q = recording.tau.copy(), recording.q.copy()
    tau[recording.t >= 4.0, 1] = 2.5
    q[recording.t >= 4.0, 1] = 0.1
    assert check_flat(replace(recording, tau=tau, q=q)) == ()
    tau = recording.tau.copy()
    tau[recording.t >= 12.0, 1] = 2.5
    assert check_flat(replace(recording, tau=tau)) == ()


@pytest.mark.whole
def test_a_torque_that_is_early_is_no_warning_beside_the_delay_that_is_found(rng):
    robot = load_robot(ROBOTS / "pendulum.urdf")
    t, w, size = np.arange(4000) / 200.0, 2 * np.pi * np.array([0.31, 0.83, 1.7]), np.array([0.5, 0.3, 0.15])

    def motion(t: np.ndarray) -> Motion:
        phase = np.outer(t, w)
        parts = np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)
        return Motion(t, *((part * size).sum(axis=1)[:, None] for part in parts))

    # A drive that acts d late is asked for a torque d before the motion that it makes.
    tau = inverse_dynamics(robot, motion(t + 0.009)) + 0.02 * rng.standard_normal((len(t), 1))
    recording = Recording("bench.csv", robot.joint_names, t, motion(t).q + 1e-5 * rng.standard_normal(tau.shape), tau)
    warnings = check_recording(recording, robot)
    assert any("early against its motion" in text for text in warnings)
    diagnosis = dyn.diagnose(robot, replace(recording, warnings=warnings))
    (found,) = diagnosis.findings
    assert (found.effect, found.parameters["delay"].value) == ("input_delay", pytest.approx(0.009, abs=1e-3))
    assert not any("against its motion" in text for text in diagnosis.warnings)
