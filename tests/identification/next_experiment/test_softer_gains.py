from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.next_experiment.trials import followed
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Controller, Robot
from phantom_dyn.motion import Motion

KP, KD, W = 40000.0, 4000.0, 2 * np.pi * 3.0


@pytest.fixture(scope="module")
def slide() -> Robot:
    """95 kg without friction, led by a controller of position."""
    slide = load_robot("emps")
    free = tuple(replace(drive, controller=Controller(kp=KP, kd=KD)) for drive in slide.actuators)
    return replace(slide, actuators=free)


def reference() -> Motion:
    """Six seconds of a sine that begins at a turn."""
    t = np.arange(3001) / 500.0
    q = 0.05 * np.cos(W * t)[:, None]
    return Motion(t, q, -0.05 * W * np.sin(W * t)[:, None], -(W**2) * q)


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_motion_is_that_of_the_linear_loop(slide, share):
    # Closed form: kp / (kp - M w^2 + i w kd), once the start has died away.
    motion = followed(slide, reference(), share)
    mass = slide.model.inertias[1].mass + float(slide.model.armature[0])
    gain = share * KP / (share * KP - mass * W**2 + 1j * W * share * KD)
    wanted = 0.05 * (gain * np.exp(1j * W * motion.t)).real
    late = motion.t > 4.0
    np.testing.assert_allclose(motion.q[late, 0], wanted[late], atol=2e-4 * 0.05)


def test_a_robot_that_states_no_controllers_has_no_softer_ones(slide):
    silent = tuple(replace(drive, controller=None) for drive in slide.actuators)
    assert followed(replace(slide, actuators=silent), reference(), 0.5) is None


def test_a_loop_that_runs_away_gives_no_motion(slide):
    wild = tuple(replace(drive, controller=Controller(kp=KP, kd=-1e6)) for drive in slide.actuators)
    assert followed(replace(slide, actuators=wild), reference(), 1.0) is None
