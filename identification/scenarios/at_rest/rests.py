"""Selects samples at standstill, with the position error of a joint and the load on its transmission."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from identification.data.checks.smoothed_copy import included
from identification.data.drives.joint_torque import external_torque
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.effects.support.encoder_lattice import stated_step, step_of
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

# Share of the largest load below which a load is not used: friction then decides where a joint with backlash rests.
LOADED = 0.2
# Loads below this one [N m or N] are rounding errors, as on a vertical axis.
_LEAST_LOAD = 1e-6


@dataclass(frozen=True)
class StandstillSamples:
    """Samples of one joint while the whole robot stands still, from all recordings in sequence.

    Attributes:
        t: Time [s], recordings one second apart.
        q: Positions of all joints [rad or m].
        error: Position minus reference of the joint [rad or m].
        load: Torque [N m or N] that its transmission passes to the link, from the model and measured forces.
        rest: Index of the rest of each sample; a rest is a stretch of standstill under one sign of load.
        quantum: Step of the joint's reading [rad or m].
    """

    t: Float[Array, " N"]
    q: Float[Array, "N nv"]
    error: Float[Array, " N"]
    load: Float[Array, " N"]
    rest: Int[Array, " N"]
    quantum: float

    def rest_medians(self, values: Float[Array, " N"]) -> Float[Array, " R"]:
        """Median of values over each rest; the median, because the load changes at its start and end."""
        return np.array([np.median(values[self.rest == k]) for k in range(self.rests)])

    @property
    def rests(self) -> int:
        """Number of rests."""
        return int(self.rest.max()) + 1 if len(self.rest) else 0

    @property
    def repeatability(self) -> float:
        """Standard deviation of the error within a rest, at least that from rounding of the readings."""
        within = self.error - self.rest_medians(self.error)[self.rest]
        freedom = max(len(within) - self.rests, 1)
        return max(float(np.sqrt((within @ within) / freedom)), self.quantum / np.sqrt(12.0))


def standstill_samples(robot: Robot, recordings: tuple[Recording, ...], row: int) -> StandstillSamples:
    """Samples of a joint under load while the whole robot stands still, numbered by rests.

    A joint stands still at a sample that differs by at most one step of its reading from both neighbours. Samples after
    a change of the joint's reference count only once the joint has moved, as a servo responds late.

    Args:
        robot: The robot, with its masses and steps of readings.
        recordings: Recordings with references.
        row: Index of the joint.

    Raises:
        LogError: If a recording has no references, or one that is not finite.
    """
    parts, start = [], 0.0
    steps = np.array([_quantum(robot, recordings, k) for k in range(robot.nv)])
    for recording in recordings:
        q_ref = _references(recording, row)
        still = _still(recording, steps) & _responded(recording.q[:, row], q_ref, steps[row]) & included(recording)
        load = (gravity_torque(robot, recording.q) - external_torque(robot, recording.q, recording.forces))[:, row]
        parts.append((recording.t - recording.t[0] + start, recording.q, recording.q[:, row] - q_ref, load, still))
        start = float(parts[-1][0][-1]) + 1.0
    largest = max((float(np.abs(load[still]).max()) for *_, load, still in parts if still.any()), default=0.0)
    selected, count = [], 0
    for t, q, error, load, still in parts:
        load_sign = np.where(still & (np.abs(load) > max(LOADED * largest, _LEAST_LOAD)), np.sign(load), 0.0)
        use = load_sign != 0
        begins = use & (load_sign != np.concatenate([[0.0], load_sign[:-1]]))
        number = np.cumsum(begins) - 1 + count
        selected.append((t[use], q[use], error[use], load[use], number[use]))
        count += int(begins.sum())
    t, q, error, load, rest = (np.concatenate(values) for values in zip(*selected, strict=True))
    return StandstillSamples(t, q, error, load, rest, float(steps[row]))


def _references(recording: Recording, row: int) -> Float[Array, " N"]:
    """References of a joint, after a check that they exist and are finite."""
    if recording.q_ref is None:
        raise LogError(
            f"{recording.file} has no q_ref.<joint> of every joint: how far a joint gives way at rest needs the "
            "references of its controller. Add them."
        )
    bad = np.flatnonzero(~np.isfinite(recording.q_ref[:, row]))
    if len(bad):
        joint = recording.joint_names[row]
        raise LogError(
            f"{recording.file}: q_ref.{joint} is {recording.q_ref[bad[0], row]} in row {bad[0]}: give a reference for "
            "every sample."
        )
    return recording.q_ref[:, row]


def _quantum(robot: Robot, recordings: tuple[Recording, ...], row: int) -> float:
    """Step of a joint's readings: as stated, else as seen in the recordings; 0 if it is neither stated nor seen."""
    stated = stated_step(robot, row)
    if stated is not None:
        return stated
    return step_of(np.concatenate([recording.q[:, row] for recording in recordings])) or 0.0


def _still(recording: Recording, steps: Float[Array, " nv"]) -> Bool[Array, " N"]:
    """True where no joint moves by more than one step from the sample before or to the one after."""
    moves = np.any(np.abs(np.diff(recording.q, axis=0)) > 1.01 * steps, axis=1)
    return ~(np.concatenate([[False], moves]) | np.concatenate([moves, [False]]))


def _responded(q: Float[Array, " N"], q_ref: Float[Array, " N"], step: float) -> Bool[Array, " N"]:
    """False from a change of the reference, or the start, until the joint has moved."""
    out = np.zeros(len(q), dtype=bool)
    changes = [0, *(np.flatnonzero(np.diff(q_ref) != 0) + 1), len(q)]
    for begin, end in pairwise(changes):
        moved = np.flatnonzero(np.abs(q[begin:end] - q[begin]) > 1.01 * step)
        if len(moved):
            out[begin + moved[0] : end] = True
    return out
