"""What comes of a reference with softer position controllers: what moves the robot late parts delays from friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot
from phantom_dyn.simulation import simulate
from phantom_dyn.tracking import position_control

GAINS = (0.5, 0.25)
"""Shares of the stated gains that are tried; larger gains may shake a robot."""


def followed(robot: Robot, reference: Motion, share: float) -> Motion | None:
    """The motion of the given model along a reference, ``kp`` and ``kd`` of all its controllers at a share.

    Args:
        robot: The given model; the delays of its controllers are left out.
        reference: What is asked for, from rest.
        share: Of the gains that the robot states.

    Returns:
        None if a joint states no controller, or the robot does not follow.
    """
    controllers = [drive.controller for drive in robot.actuators]
    stated = [controller for controller in controllers if controller is not None and controller.kp > 0]
    if not controllers or len(stated) < len(controllers):
        return None
    kp, kd = (share * np.array(gains) for gains in ([c.kp for c in stated], [c.kd for c in stated]))
    law = position_control(reference.t, reference.q, np.zeros_like(reference.q), kp=kp, kd=kd)
    instant = replace(robot, torque_hold="instant")
    try:
        return simulate(instant, (), law, reference.t, reference.q[0]).links
    except ParameterError:
        return None
