"""Unmeasured pushes: short stretches in which the residual of a joint far exceeds its usual level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.model.standstill import usable_samples
from identification.diagnosis.result import Judgement

Array = np.ndarray

# Two of them that are as close [s] are one.
_CLOSE = 0.4
# Left out before and behind a push [s], so that no filter carries it over.
_MARGIN = 0.2


@dataclass(frozen=True)
class Push:
    """A transient force on one joint.

    Attributes:
        joint: The one that feels it most.
        start, stop: Times of the recording [s].
        torque: The most that it leaves [N m or N], positive along the joint.
    """

    joint: str
    start: float
    stop: float
    torque: float


def push_warnings(judgement: Judgement, logs: tuple[Log, ...]) -> tuple[str, ...]:
    """A sentence for every push that no sensor measured.

    Args:
        judgement: Its evidence holds the samples of all logs, one after the other.
        logs: As they were judged.
    """
    evidence = judgement.evidence
    # What the drive gives less than the model needs is pushed from outside.
    left = evidence.tau_after - evidence.tau_measured
    floor = np.array([joint.noise_floor for joint in judgement.joints])
    start, out = 0, []
    for log in logs:
        stop = start + len(log.samples)
        pushes = pushes_in(log.motion.t[log.samples], left[start:stop], usable_samples(log), floor, log.joint_names)
        units = {joint.joint: joint.unit for joint in judgement.joints}
        out += [_sentence(log.file, push, units[push.joint]) for push in pushes]
        start = stop
    return tuple(out)


def pushes_in(
    t: Float[Array, " n"],
    left: Float[Array, "n nv"],
    usable: Bool[Array, "n nv"],
    floor: Float[Array, " nv"],
    joints: tuple[str, ...],
) -> tuple[Push, ...]:
    """Pushes in one recording, in the order of time.

    Args:
        t: Times [s].
        left: Unexplained torque of each joint, positive along the joint.
        usable: False where a joint rests or a sample is excluded.
        floor: Noise of each joint's torque.
        joints: Their names.
    """
    found: list[Push] = []
    for j, joint in enumerate(joints):
        residual = np.where(usable[:, j], left[:, j], 0.0)
        for first, last in _loud(t, residual, usable[:, j], float(floor[j])):
            peak = int(first + np.argmax(np.abs(residual[first : last + 1])))
            found.append(Push(joint, float(t[first]), float(t[last]), float(residual[peak])))
    # A push on the last link is felt by all joints: said once, for the joint that feels it most.
    out: list[Push] = []
    for push in sorted(found, key=lambda push: -abs(push.torque)):
        if all(push.stop < other.start - _CLOSE or push.start > other.stop + _CLOSE for other in out):
            out.append(push)
    return tuple(sorted(out, key=lambda push: push.start))


def _loud(t: Array, residual: Array, usable: Array, floor: float) -> list[tuple[int, int]]:
    """First and last samples of stretches whose residual far exceeds the median; none where there are many."""
    if np.count_nonzero(usable) < 50:
        return []
    step = float(np.median(np.diff(t)))
    width = max(round(rules.PUSH_WINDOW / step), 1)
    level = np.sqrt(np.convolve(residual**2, np.ones(width) / width, mode="same"))
    usual = max(float(np.median(level[usable])), floor, 1e-12)
    at = np.flatnonzero(level > rules.PUSH_TIMES * usual)
    if len(at) == 0:
        return []
    breaks = np.flatnonzero(np.diff(t[at]) > _CLOSE)
    runs = list(zip(at[np.r_[0, breaks + 1]], at[np.r_[breaks, len(at) - 1]], strict=True))
    inside = np.zeros(len(t), dtype=bool)
    for first, last in runs:
        inside[first : last + 1] = True
    share = float((residual[inside] ** 2).sum() / max((residual**2).sum(), 1e-300))
    long = float(inside.mean()) > rules.LONGEST_PUSH
    return (
        [] if len(runs) > rules.MOST_PUSHES or long or share < rules.PUSH_SHARE else [(int(a), int(b)) for a, b in runs]
    )


def _sentence(file: str, push: Push, unit: str) -> str:
    out = f"{push.start - _MARGIN:.2f}:{push.stop + _MARGIN:.2f}"
    return (
        f"{file}: from {push.start:.2f} to {push.stop:.2f} s joint {push.joint} was pushed by a force that no sensor "
        f"measured, with up to {push.torque:.3g} {unit}: if it was a contact, leave it out with --exclude "
        f"{out}, or record its force in columns f.<frame>.x, .y and .z."
    )
