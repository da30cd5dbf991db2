"""Describes the estimated position controllers of the drives, and compares stated controllers with the torque."""

from __future__ import annotations

import numpy as np

from identification.data.drive_loop import DriveLoop
from identification.data.drives.joint_torque import voltage_bound
from identification.data.recording import Recording
from phantom_dyn.array_types import Array
from phantom_dyn.model.robot import Actuator, Controller, Robot

_COLUMN = {"u": "voltage", "i": "current", "tau": "torque"}
_UNIT = {"u": "V", "i": "A", "tau": "N m"}
# A stated controller is reported if the logged torque differs from its torque by more than the first factor, or if its
# torque explains less than the second share of the logged torque.
_FACTOR, _EXPLAINED = 1.25, 0.5
# Delays [s] of the reference with which a stated controller is tried: a late reference does not make it wrong.
_DELAYS = np.arange(0.0, 0.1, 0.01)
_FEWEST = 100


def loop_sentences(recording: Recording) -> tuple[str, ...]:
    """A sentence on each drive whose position controller could be estimated.

    Args:
        recording: A recording with estimated loops.
    """
    pairs = zip(recording.joint_names, recording.loops, strict=False)
    frame = float(np.median(np.diff(recording.t))) if recording.references_held else 0.0
    return tuple(_sentence(joint, loop, frame) for joint, loop in pairs if loop is not None)


def _sentence(joint: str, loop: DriveLoop, frame: float) -> str:
    """Description of an estimated controller.

    Args:
        joint: Name of the joint.
        loop: The estimated controller.
        frame: Time [s] for which a reference is held; 0 if references are not held.
    """
    unit = _UNIT[loop.output]
    parts = [f"gain {loop.gain:.4g} ± {loop.gain_std:.2g} {unit} per rad or m of error"]
    if not loop.computed:
        # A reference that is held for a frame arrived at an unknown time within the frame before the sample.
        first = f"{1e3 * max(loop.delay - frame, 0.0):.3g} to " if frame else ""
        parts.append(f"its reference {first}{1e3 * loop.delay:.3g} ± {1e3 * loop.delay_std:.2g} ms late")
    if loop.limit is not None:
        parts.append(f"clipped at {loop.limit:.4g} {unit} for {100 * loop.at_limit:.2g} % of the time")
    if loop.dropped:
        parts.append(
            f"no more than {loop.drops_to:.3g} {unit} beyond an error of {loop.drops_beyond:.3g}, for "
            f"{100 * loop.dropped:.2g} % of the time (it protects itself)"
        )
    if loop.dead_band is not None:
        parts.append(f"nothing below an error of {loop.dead_band:.3g}")
    if loop.hold is not None:
        parts.append(f"a reference every {1e3 * loop.hold:.3g} ms")
    described = f"loop of {joint}, from its {_COLUMN[loop.output]}: {', '.join(parts)}"
    if loop.computed:
        return (
            f"{described}; it follows reference and position to the last digit, so that it was computed, not measured"
        )
    return f"{described}; {loop.residual_rms:.2g} {unit} rms are left"


def check_computed(recording: Recording) -> tuple[str, ...]:
    """A warning on voltages that were computed from reference and position: these do not show the drive's delay."""
    if recording.reference_gain is None or recording.controlled:
        return ()
    joints = [joint for joint, gain in zip(recording.joint_names, recording.reference_gain, strict=True) if gain]
    names = ", ".join(f"u.{joint}" for joint in joints)
    return (
        f"{recording.file}: {names} was computed from reference and position, not measured: it does not show how late "
        "the drive gets its reference, so this delay is looked for.",
    )


def check_controllers(recording: Recording, robot: Robot) -> tuple[str, ...]:
    """A sentence on each joint whose stated controller does not give the logged torque.

    Args:
        recording: Raw samples.
        robot: The robot with the stated controllers.
    """
    if recording.q_ref is None or recording.tau is None or recording.controlled or len(recording.t) < _FEWEST:
        return ()
    v = np.gradient(recording.q, recording.t, axis=0) if recording.v is None else recording.v
    out = []
    for j, (joint, actuator) in enumerate(zip(robot.joint_names, robot.actuators, strict=True)):
        controller = actuator.controller
        if controller is None or controller.kp <= 0 or not np.ptp(recording.tau[:, j]) > 0:
            continue
        gain, explained = _compared(recording, j, actuator, controller, v[:, j])
        if explained >= _EXPLAINED and 1 / _FACTOR <= gain <= _FACTOR:
            continue
        out.append(
            f"{recording.file}: the stated controller of {joint} (kp {controller.kp:.4g}, kd {controller.kd:.4g}) does "
            f"not give its logged torque: {gain:.3g} times what it asks for explains {100 * max(explained, 0.0):.0f} % "
            "of it. Correct the gains in robot.yaml, or leave them out: what is simulated or estimated with them would "
            "be wrong."
        )
    return tuple(out)


def _compared(
    recording: Recording, j: int, actuator: Actuator, controller: Controller, v: Array
) -> tuple[float, float]:
    """Factor from commanded to logged torque, and the share of the logged torque that the product explains.

    Both are those of the delay with the largest share.

    Args:
        recording: Raw samples.
        j: Index of the joint.
        actuator: The drive of the joint.
        controller: The stated controller.
        v: Velocity of the joint [rad/s or m/s].
    """
    assert recording.q_ref is not None
    assert recording.tau is not None
    t, q = recording.t, recording.q[:, j]
    tau = recording.tau[:, j] - recording.tau[:, j].mean()
    best = (0.0, -np.inf)
    for delay in _DELAYS + controller.delay + controller.reference_delay:
        error = np.interp(t - delay, t, recording.q_ref[:, j]) - q
        at_voltage_limit, limit = voltage_bound(actuator), actuator.torque_limit or np.inf
        stiff = np.clip(controller.stiff_part(error), -at_voltage_limit, at_voltage_limit)
        commanded = np.clip(stiff - controller.kd * v, -limit, limit)
        commanded = commanded - commanded.mean()
        power = float(commanded @ commanded)
        if power > 0:
            gain = float(commanded @ tau) / power
            residual = tau - gain * commanded
            best = max(best, (gain, 1.0 - float(residual @ residual) / float(tau @ tau)), key=lambda one: one[1])
    return best
