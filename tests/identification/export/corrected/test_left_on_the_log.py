"""Corrected files leave on the recording no more than the diagnosis says. Oracle: the recording, and Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.signals import process_all
from identification.diagnosis.columns.operations import operate
from identification.export.corrected.found_effects import effect_of, lasting_findings
from identification.pipeline import diagnose
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.support.changed_robot import with_gravity, with_parameters
from phantom_dyn.model.inertia import point_mass_parameters

pytestmark = pytest.mark.whole

HELD_OUT = 1.25  # what is stated is left by fits that have not seen a block, what is exported by one that has


def left(robot, recording, diagnosis):
    """What the findings leave of the recorded torque in the band, root mean square."""
    (log,), _ = process_all((recording,), robot)
    known = tuple(effect_of(robot, finding) for finding in lasting_findings(diagnosis))
    rest = log.band(log.tau - operate(robot, log, known).tau)
    return np.sqrt(np.mean(rest**2, axis=0))


def test_where_gravity_points_along_the_axis(lab, pendulum, trusted):
    # A hardening spring is in no catalogue: whatever is named in its place, what is stated is what is left.
    robot = trusted(with_gravity(pendulum, np.array([0.0, -9.81, 0.0])))
    motion = lab.motion(1, 3, seconds=20.0, swing=1.5)
    recording = lab.recording(robot, motion, -2.0 * motion.q**3, noise=0.01)
    diagnosis = diagnose(robot, (recording,))
    assert diagnosis.findings
    assert left(robot, recording, diagnosis)[0] < HELD_OUT * diagnosis.joints[0].rms_after


def test_friction_under_the_load_of_a_payload(lab, planar2, trusted):
    # Known truth: the friction is a tenth of what the transmission passes with the payload.
    robot, motion = trusted(planar2), lab.motion(2, 3, seconds=20.0, swing=1.5)
    added = np.zeros_like(standard_parameters(robot))
    added[10:] = point_mass_parameters(1.5, np.array([0.0, 0.0, -0.4]))
    heavier = with_parameters(robot, added)
    rubbed = lab.acting(heavier, motion, "load_dependent_friction", "shoulder", 0.1)
    recording = lab.recording(heavier, motion, rubbed, noise=0.02)
    diagnosis = diagnose(robot, (recording,))
    found = {finding.effect: finding for finding in diagnosis.findings}
    ratio = found["load_dependent_friction"].parameters["ratio"]
    value, std = (float(np.ravel(x)[0]) for x in (ratio.value, ratio.std))
    assert abs(value - 0.1) < 2.5 * std < 0.02
    after = np.array([joint.rms_after for joint in diagnosis.joints])
    assert np.all(left(robot, recording, diagnosis) < HELD_OUT * after)
