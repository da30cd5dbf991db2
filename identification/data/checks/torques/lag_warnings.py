"""Warnings on torques that are late or early relative to the motion, with advice on how to correct the data."""

from __future__ import annotations

from identification.data.checks.smoothed_copy import SmoothedRecording
from identification.data.checks.torques.torque_lag import CLEARLY, Lag, LowPass, is_reported, low_pass_is_reported
from identification.data.recording import Recording
from phantom_dyn.model.robot import Robot


class LagSentence(str):
    """The warning on a torque that is late or early, with the joint and the direction for later stages.

    Attributes:
        joint: Name of the joint.
        early: True if the torque is early relative to the motion, as a commanded torque is if the drive is slow.
    """

    joint: str
    early: bool

    def __new__(cls, sentence: str, joint: str, *, early: bool) -> LagSentence:
        """The sentence with its attributes."""
        out = super().__new__(cls, sentence)
        out.joint, out.early = joint, early
        return out


def check_lag(
    recording: Recording,
    robot: Robot,
    smooth: SmoothedRecording,
    found: tuple[tuple[Lag | None, LowPass | None], ...],
    *,
    higher_order: tuple[str, ...] = (),
) -> tuple[str, ...]:
    """Warnings on torques that are late or early by about half a sample or more.

    Args:
        recording: Raw samples.
        robot: States whether a drive holds its torque between two samples.
        smooth: The smoothed copy of the recording.
        found: Result of `lags_and_low_passes`.
        higher_order: Joints whose torque went through a low pass of second or higher order. Inverting a first-order low
            pass would not undo it.
    """
    out = []
    for any_lag, any_low_pass in found:
        lag = any_lag if any_lag is not None and is_reported(any_lag) else None
        low_pass = any_low_pass
        if low_pass is not None and (low_pass.joint in higher_order or not low_pass_is_reported(low_pass, smooth.step)):
            low_pass = None
        if low_pass is not None and (low_pass.beside_shift < CLEARLY or lag is None):
            out.append(
                f"{recording.file}: the torque of {low_pass.joint} went through a low pass of first order at "
                f"{low_pass.hertz:.3g} Hz that the positions did not go through: {_low_pass_advice(low_pass)}."
            )
        elif lag is not None:
            out.append(_lag_sentence(recording.file, robot, smooth, lag, low_pass))
    return tuple(out)


def _low_pass_advice(low_pass: LowPass) -> str:
    """Advice on how to invert a low pass."""
    return (
        f"write tau.{low_pass.joint}: {{low_pass: {low_pass.hertz:.3g}}} into a column map and give it with --columns"
    )


def _lag_sentence(file: str, robot: Robot, smooth: SmoothedRecording, lag: Lag, low_pass: LowPass | None) -> str:
    """The warning on a torque that is late or early, with the advice to shift the torque or to invert a low pass.

    If the robot's file does not state a hold, a lag of half a sample may come from a hold of the torque.
    """
    hint = "shift it, or expect it to show as a delay"
    if low_pass is not None and low_pass.beside_shift < 1 / CLEARLY:
        hint = f"shift it, or, if it went through a low pass of first order, {_low_pass_advice(low_pass)}"
    if robot.torque_hold == "instant" and abs(lag.samples + 0.5) < max(0.25, 3 * lag.std):
        hint = "torque_hold: zoh in robot.yaml explains half a sample"
    word = "late" if lag.samples > 0 else "early"
    sentence = (
        f"{file}: the torque of {lag.joint} is {word} against its motion by "
        f"{1e3 * abs(lag.samples) * smooth.step:.3g} ms ({abs(lag.samples):.2g} samples): {hint}."
    )
    return LagSentence(sentence, lag.joint, early=lag.samples < 0)
