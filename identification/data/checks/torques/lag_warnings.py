"""Warnings on torques that are late or early against the motion, with advice on how to mend the data."""

from __future__ import annotations

from identification.data.checks.smoothed_copy import Smooth
from identification.data.checks.torques.torque_lag import CLEARLY, Lag, LowPass, is_reported, low_pass_is_reported
from identification.data.recording import Recording
from phantom_dyn.model.robot import Robot


class LagSentence(str):
    """A sentence on a torque that is late or early; it carries what later stages need to know.

    Attributes:
        joint: Name of the joint.
        early: True if the torque is early against the motion, as a commanded torque is if the drive is slow.
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
    smooth: Smooth,
    found: tuple[tuple[Lag | None, LowPass | None], ...],
    *,
    higher_order: tuple[str, ...] = (),
) -> tuple[str, ...]:
    """Warnings on torques that are late or early by about half a sample or more.

    Args:
        recording: Raw samples.
        robot: States how the torque was held.
        smooth: The smoothed copy.
        found: Result of `lags_and_low_passes`.
        higher_order: Joints whose torque went through a low pass of higher order, which inverting a first-order one
            would not undo.
    """
    out = []
    for each, filtered in found:
        lag = each if each is not None and is_reported(each) else None
        if filtered is not None and (filtered.joint in higher_order or not low_pass_is_reported(filtered, smooth.step)):
            filtered = None
        if filtered is not None and (filtered.beside_shift < CLEARLY or lag is None):
            out.append(
                f"{recording.file}: the torque of {filtered.joint} went through a low pass of first order at "
                f"{filtered.hertz:.3g} Hz that the positions did not go through: {_low_pass_advice(filtered)}."
            )
        elif lag is not None:
            out.append(_lag_sentence(recording.file, robot, smooth, lag, filtered))
    return tuple(out)


def _low_pass_advice(filtered: LowPass) -> str:
    """Advice on how to invert a low pass."""
    return (
        f"write tau.{filtered.joint}: {{low_pass: {filtered.hertz:.3g}}} into a column map and give it with --columns"
    )


def _lag_sentence(file: str, robot: Robot, smooth: Smooth, lag: Lag, filtered: LowPass | None) -> str:
    """The warning on a torque that is late or early; a low pass may be the cause of a late one."""
    hint = "shift it, or expect it to show as a delay"
    if filtered is not None and filtered.beside_shift < 1 / CLEARLY:
        hint = f"shift it, or, if it went through a low pass of first order, {_low_pass_advice(filtered)}"
    if robot.torque_hold == "instant" and abs(lag.samples + 0.5) < max(0.25, 3 * lag.std):
        hint = "torque_hold: zoh in robot.yaml explains half a sample"
    word = "late" if lag.samples > 0 else "early"
    sentence = (
        f"{file}: the torque of {lag.joint} is {word} against its motion by "
        f"{1e3 * abs(lag.samples) * smooth.step:.3g} ms ({abs(lag.samples):.2g} samples): {hint}."
    )
    return LagSentence(sentence, lag.joint, early=lag.samples < 0)
