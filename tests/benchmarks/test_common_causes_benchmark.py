"""Cases of causes that several joints have in common. Oracles: Pinocchio's torques with what was put in, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.common_causes import Case

# Seeds that draw each of the three arms.
SEEDS = range(6)


@pytest.mark.parametrize("kind", ["scale", "line", "load"])
def test_a_case_of_every_arm_has_recordings_of_its_joints_and_says_what_was_put_in(kind):
    drawn = [Case(kind, seed, null=False) for seed in SEEDS]
    assert {case.robot.name for case in drawn} == {"ur5", "ur10", "panda"}
    for case in drawn:
        assert case.truth.sizes
        for recording in case.recordings:
            assert recording.tau.shape == recording.q.shape == (len(recording.t), case.robot.nv)


def test_readings_times_the_ratio_of_a_case_are_its_torques():
    # By hand: the same seed without the cause draws the same motion, friction and joints.
    for seed in SEEDS:
        scaled, plain = (Case("scale", seed, null=null) for null in (False, True))
        (place,) = [place for place in scaled.truth.sizes if place[0] == "torque_constant"]
        rows = np.array([name in str(place[1]).split("+") for name in scaled.robot.joint_names])
        ratio = np.where(rows, scaled.truth.sizes[place], 1.0)
        (read,), (true,) = scaled.recordings, plain.recordings
        # Noise of 4 per mil of each.
        left = np.sqrt(np.mean((read.tau * ratio - true.tau) ** 2, axis=0) / np.mean(true.tau**2, axis=0))
        assert np.all((left < 0.02) | (np.abs(true.tau).max(axis=0) < 0.5))


def test_joints_of_a_case_on_one_line_move_alike():
    for seed in SEEDS:
        v = np.diff(Case("line", seed, null=False).recordings[0].q, axis=0)
        assert np.abs(np.corrcoef(v.T)).min() > 0.98
