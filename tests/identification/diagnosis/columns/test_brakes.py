"""Rests on a brake. Oracle: torques of the model, from which the drive's part is taken while the brake holds."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from identification.data.signals import process
from identification.diagnosis.columns.motion.brakes import with_brakes
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion


def from_point_to_point(rate: float = 200.0, rest: float = 1.5, move: float = 1.0) -> tuple[Motion, np.ndarray]:
    """A pendulum that moves between three angles and rests at each, and where it rests, ``(N,)``."""
    s = np.arange(0.0, 1.0, 1.0 / (rate * move))
    smooth, slope = 10 * s**3 - 15 * s**4 + 6 * s**5, (30 * s**2 - 60 * s**3 + 30 * s**4) / move
    bend = (60 * s - 180 * s**2 + 120 * s**3) / move**2
    q, v, a, at_rest = [], [], [], []
    angles = [0.4, 1.3, 0.7] * 3
    for start, stop in pairwise(angles):
        still = np.zeros(int(rest * rate))
        q += [start + still, start + (stop - start) * smooth]
        v += [still, (stop - start) * slope]
        a += [still, (stop - start) * bend]
        at_rest += [np.ones(len(still), dtype=bool), np.zeros(len(s), dtype=bool)]
    q, v, a = (np.concatenate(each)[:, None] for each in (q, v, a))
    return Motion(np.arange(len(q)) / rate, q, v, a), np.concatenate(at_rest)


def test_a_rest_without_torque_under_weight_gets_that_of_the_model(lab, pendulum):
    motion, at_rest = from_point_to_point()
    recording = lab.recording(pendulum, motion, noise=0.01)
    braked = replace(recording, tau=np.where(at_rest[:, None], 0.0, recording.tau))
    log = process(braked, pendulum)
    needed = inverse_dynamics(pendulum, log.motion)
    assert np.abs(log.tau - needed)[at_rest].max() > 0.5 * np.abs(needed).max()
    replaced = with_brakes(pendulum, log)
    assert replaced.braked == pendulum.joint_names
    assert np.abs(replaced.tau - needed)[at_rest].max() < 0.1 * np.abs(needed).max()


def test_a_drive_that_bears_the_weight_in_rests_keeps_its_torque(lab, pendulum):
    motion, _ = from_point_to_point()
    log = process(lab.recording(pendulum, motion, noise=0.01), pendulum)
    np.testing.assert_array_equal(with_brakes(pendulum, log).tau, log.tau)
    assert with_brakes(pendulum, log).braked == ()


def test_a_torque_without_any_weight_is_not_a_brakes(lab, pendulum):
    # Known truth: a controller has taken the weight out of all torques, also of those in motion.
    motion, _ = from_point_to_point()
    recording = lab.recording(pendulum, motion, noise=0.01)
    weight = inverse_dynamics(pendulum, replace(motion, v=0.0 * motion.v, a=0.0 * motion.a))
    log = process(replace(recording, tau=recording.tau - weight), pendulum)
    np.testing.assert_array_equal(with_brakes(pendulum, log).tau, log.tau)
