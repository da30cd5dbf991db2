"""Drives of the joints: ``robot.yaml`` takes precedence over the URDF or MJCF of the robot."""

from __future__ import annotations

import numpy as np

from phantom_dyn.model.robot import Actuator, Controller
from phantom_dyn.model.robot_config import ControllerConfig, JointConfig
from phantom_dyn.model.robot_xml import Drive


def actuator_of(stated: JointConfig, armature: float, from_file: Drive) -> Actuator:
    """The drive of a joint.

    Args:
        stated: Entry of the joint in ``robot.yaml``.
        armature: Rotor inertia in the URDF or MJCF [kg m^2 or kg].
        from_file: Other properties of the drive in the URDF or MJCF.
    """
    controller = _controller(stated, stated.controller) if stated.controller else None
    if controller is None and from_file.kp is not None:
        controller = Controller("pd", from_file.kp, from_file.kd or 0.0)
    return Actuator(
        rotor_inertia=armature if stated.rotor_inertia is None else stated.rotor_inertia,
        gear_ratio=stated.gear_ratio if stated.gear_ratio != 1.0 else from_file.gear_ratio or 1.0,
        torque_constant=stated.torque_constant,
        torque_limit=from_file.torque_limit if stated.torque_limit is None else stated.torque_limit,
        encoder_counts=stated.encoder_counts,
        encoder_side=stated.encoder_side,
        actuated=stated.actuated,
        drive_known=stated.drive is None,  # ``drive: unknown`` is the only value of this key
        resistance=stated.resistance,
        voltage_limit=stated.voltage_limit,
        controller=controller,
        # A stated delay of the reference replaces the filter of the robot file.
        reference_lag=0.0 if controller is not None and controller.reference_delay else from_file.reference_lag,
    )


def _controller(drive: JointConfig, stated: ControllerConfig) -> Controller:
    r"""The controller of a joint, with gains that give joint torque.

    A ``duty`` controller applies the share :math:`g\,(q_r - q)` of the supply voltage U to the motor. With torque
    constant k, gear ratio n and resistance R this gives :math:`\tau = (k n U / R)\,g\,(q_r - q) - ((k n)^2 / R)\,v`.
    """
    if stated.kind == "pd":
        return Controller("pd", stated.kp or 0.0, stated.kd or 0.0, stated.delay, stated.reference_delay)
    # Reading robot.yaml refuses a ``duty`` controller without these numbers.
    assert drive.torque_constant is not None
    assert drive.resistance is not None
    assert drive.voltage_limit is not None
    assert stated.gain is not None
    constant = drive.torque_constant * drive.gear_ratio
    stall_torque = constant * drive.voltage_limit / drive.resistance
    return Controller(
        "duty",
        kp=stated.gain * stall_torque,
        kd=constant**2 / drive.resistance,
        delay=stated.delay,
        reference_delay=stated.reference_delay,
        limit=stall_torque * (1.0 if stated.limit is None else stated.limit),
        drops_beyond=np.inf if stated.drops_beyond is None else stated.drops_beyond,
        drops_to=np.inf if stated.drops_to is None else stall_torque * stated.drops_to,
    )
