"""Estimates the spurious torque, and spurious gains of effects, that encoder noise causes (errors in variables).

The gain of an effect is the decrease of the weighted squared residual if the effect is added to the fit. Columns and
modelled torque are computed from the same measured positions. Both contain the same noise, so a fit can explain noise
by noise. Resampling of residuals does not show this. So the recording is simulated: its smooth motion is taken as the
true one, new encoder noise of the same kind is added, and columns and torque are computed again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.data.derivatives import differentiate, position_edges
from identification.data.log import Log
from identification.diagnosis.columns.one_recording_effects import Differences
from identification.diagnosis.columns.operations import operation_of
from identification.diagnosis.columns.residual_columns import Columns, columns_by_log
from identification.diagnosis.columns.session import Series, Session
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.problem import Problem, set_up
from identification.diagnosis.noise.whitening import squares_by_row, whitened, whitening_of
from identification.diagnosis.search.search import Search
from identification.engine.claims import GateResult
from identification.engine.fits.projection import gains_if_added
from identification.engine.products.grams import RowGrams, all_row_grams
from identification.gates import above_chance
from identification.gates.coarse_reading import coarser_than_others, coarser_than_stated
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.encoder_lattice import stated_step
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

# Step [rad or m] of an encoder that is practically exact: rounding to it causes no torque.
_EXACT_STEP = 1e-12


@dataclass(frozen=True)
class CoarseJoint:
    """A joint whose readings have larger steps than stated, or than those of other joints if no step is stated.

    Attributes:
        row: Index of the joint.
        step: Step of the readings [rad or m].
        torque: For each log, the spurious in-band torque from rounding, beyond that from rounding to the expected
            step, ``(n, nv)``.
        usual_low_pass: The same torque with the low pass for finer readings (`motion_edge`). The low pass of ``torque``
            may have a lower edge, because of the steps.
        coarser: Result of the gate that compared the steps.
    """

    row: int
    step: float
    torque: tuple[Float[Array, "n nv"], ...]
    usual_low_pass: tuple[Float[Array, "n nv"], ...]
    coarser: GateResult


def simulated_log(log: Log, operation: Operation, steps: tuple[float | None, ...], rng: np.random.Generator) -> Log:
    """A simulated log: the same motion read with new encoder noise, and the torque that the model needs for it.

    Args:
        log: A recording.
        operation: Motion of the log, taken as the true one, and the model's torque.
        steps: Step of each joint's readings [rad or m]. For a joint without a step, the noise is the recorded one (raw
            minus smooth readings), shifted in time.
        rng: Draws the zero of each encoder, and the shift in time.
    """
    motion, count = log.motion, len(log.motion.t)
    noise = np.zeros_like(motion.q)
    for j, step in enumerate(steps):
        if step is not None:
            zero = rng.uniform(0, step)
            noise[:, j] = np.round((motion.q[:, j] - zero) / step) * step + zero - motion.q[:, j]
        elif log.raw_q is not None:
            noise[:, j] = np.roll(log.raw_q[:, j] - motion.q[:, j], int(rng.integers(count // 4, count // 2)))
    q, v, a = differentiate(motion.q + noise, log.band.rate_hz, position_edges(log))
    return replace(log, motion=motion.with_joints(q, v, a), tau=operation.tau, raw_q=motion.q + noise)


def coarsest_steps(logs: tuple[Log, ...]) -> tuple[float | None, ...]:
    """Largest step of each joint's readings in any log; None for a joint without a step in one of the logs."""
    out: list[float | None] = []
    for steps in zip(*(log.reading_steps for log in logs), strict=True):
        known = [step for step in steps if step is not None]
        out.append(max(known) if len(known) == len(steps) else None)
    return tuple(out)


def coarse_joints(session: Session, columns: Columns, steps: tuple[float | None, ...]) -> tuple[CoarseJoint, ...]:
    """Joints whose readings have larger steps than expected, and the spurious torque that this causes."""
    robot, out = session.robot, []
    for j, step in enumerate(steps):
        stated = stated_step(robot, j)
        expected = _step_of_others(robot, steps, j) if stated is None else stated
        if step is None or expected is None:
            continue
        gate = coarser_than_others if stated is None else coarser_than_stated
        coarser = gate(step / expected)
        if not coarser.passed:
            continue
        # The encoders of the other joints are taken as exact.
        only_this = tuple(step if k == j else _EXACT_STEP for k in range(robot.nv))
        # Only the variance of the rounding error beyond that of the expected step counts.
        share = float(np.sqrt(1.0 - min((expected / step) ** 2, 1.0)))
        pairs = tuple(zip(session.logs, columns.operations, strict=True))
        torque = tuple(share * _rounding_torque(log, motion, only_this) for log, motion in pairs)
        usual = tuple(
            share * _rounding_torque(replace(log, position_edges=None), motion, only_this) for log, motion in pairs
        )
        out.append(CoarseJoint(j, step, torque, usual, coarser))
    return tuple(out)


def _rounding_torque(log: Log, operation: Operation, steps: tuple[float | None, ...]) -> Float[Array, "n nv"]:
    """Change of the modelled in-band torque if the motion of a log is read with the given steps of the encoders."""
    rounded = simulated_log(log, operation, steps, random_stream("coarse readings")).motion
    return log.band(inverse_dynamics(operation.robot, rounded) - inverse_dynamics(operation.robot, log.motion))


def _step_of_others(robot: Robot, steps: tuple[float | None, ...], j: int) -> float | None:
    """Median step of the other joints of the same kind (revolute or prismatic); None if most of them have no step."""
    others = [step for k, step in enumerate(steps) if k != j and robot.prismatic[k] == robot.prismatic[j]]
    known = [step for step in others if step is not None]
    return float(np.median(known)) if 2 * len(known) > len(others) else None


@dataclass(frozen=True)
class SimulatedRecordings:
    """Simulated recordings of a robot that moves like its model, with encoders as noisy as the recorded ones.

    Attributes:
        session: Session with new readings in each log.
        residual: Torque residual of the simulated recordings, due to encoder noise alone, for each log ``(n, nv)``.
    """

    session: Session
    residual: Series


def simulated_recordings(session: Session, columns: Columns, steps: tuple[float | None, ...]) -> SimulatedRecordings:
    """Simulated recordings: the smooth motion of each one with new encoder noise, and the torque that the model needs.

    Args:
        session: The recordings.
        columns: Columns of the recordings.
        steps: Step of each joint's readings, from `coarsest_steps`.
    """
    rng = random_stream("readings with fresh noise")
    pairs = zip(session.logs, columns.operations, strict=True)
    logs = tuple(simulated_log(log, operation, steps, rng) for log, operation in pairs)
    differences = Differences(tuple(operation.robot for operation in columns.operations))
    simulated = replace(session, logs=logs, differences=differences)
    # The measured torque is the model's torque for the true motion; the modelled torque is computed from the readings.
    residual = [
        log.band(log.tau - operation_of(operation.robot, log, session.known, k, session.cutoff_hz).tau)
        for k, (log, operation) in enumerate(zip(logs, columns.operations, strict=True))
    ]
    return SimulatedRecordings(simulated, tuple(residual))


def at_least_encoder_noise(noise: Series, encoders: Series, usable: Sequence[Bool[Array, "n nv"]]) -> Series:
    """Noise of each row (one joint's torque): the estimate, or the noise of the encoders if that is larger.

    The estimates come from flexible fits. These explain encoder noise by columns with the same noise, so that an
    estimate may be too small.

    Args:
        noise: The estimates, for each log ``(n, nv)``.
        encoders: Torque that the noise of the encoders causes, for each log ``(n, nv)``.
        usable: True for samples that are used.
    """
    smaller = squares_by_row(noise, usable) < squares_by_row(encoders, usable)
    return tuple(
        np.where(smaller, np.where(use, spurious, 0.0), part)
        for part, spurious, use in zip(noise, encoders, usable, strict=True)
    )


def spurious_gains(
    search: Search, simulated: SimulatedRecordings, noise: Series
) -> dict[tuple[str, str | None], float]:
    """In-sample gain of each effect on each joint from encoder noise alone; zero if it is too small for any claim.

    Args:
        search: Problem and candidate effects of the recordings.
        simulated: The simulated recordings with new encoder noise.
        noise: Noise from which the whitening filters are computed.
    """
    problem = search.problem
    encoders = whitening_of(problem.columns, noise).series(simulated.residual)
    largest_gain = float(squares_by_row(encoders, problem.columns.usable) @ problem.weights.per_sample)
    # No effect can gain more than the weighted sum of squares of all encoder noise.
    if largest_gain < above_chance.LEAST_GAIN:
        return dict.fromkeys((term.effect_joint for term in search.terms), 0.0)
    null = _null_problem(problem, simulated, noise)
    gains = gains_if_added(null, fit(null, (), held_out=False), {term.columns for term in search.terms})
    out: dict[tuple[str, str | None], float] = {}
    for term in search.terms:
        out[term.effect_joint] = max(gains[term.columns], out.get(term.effect_joint, 0.0))
    return out


def _null_problem(problem: Problem, simulated: SimulatedRecordings, noise: Series) -> Problem:
    """The fitting problem of the simulated recordings, for fits without held-out blocks.

    To save memory, columns are computed for one log at a time.
    """
    columns, values = columns_by_log(simulated.session, problem.columns)
    filters, (white, _) = whitening_of(columns, noise), whitened(columns, noise)
    # All blocks that fits may use become one fold. Blocks that no fit may use keep -1.
    session = replace(problem.session, folds=np.minimum(problem.session.folds, 0))
    rows: tuple[RowGrams, ...] = ()
    for log in range(len(session.logs)):
        of_log, one = [k for k, block in enumerate(session.blocks) if block.log == log], slice(log, log + 1)
        blocks = tuple(replace(session.blocks[k], log=0) for k in of_log)
        own = filters.columns(values(log), log)
        alone = replace(white, values=(own,), residual=white.residual[one], usable=white.usable[one])
        more = map(_without_cores, all_row_grams(alone, blocks, session.folds[of_log], problem.weights))
        rows = tuple(map(_joined, rows, more)) if rows else tuple(more)
    return set_up(session, columns, white, problem.weights, rows)


def _without_cores(row: RowGrams) -> RowGrams:
    """Products of one row without those over the core of each block, because only held-out fits need these."""
    # `row.a` has the products of each fold, and last those of the blocks that no fit may use. For a log with only such
    # blocks the fold is missing, and its products are zero.
    with_fold = row.a if len(row.a) > 1 else np.concatenate([np.zeros_like(row.a), row.a])
    return replace(row, a=with_fold.copy(), core_a=np.empty((0, *row.core_a.shape[1:])))


def _joined(first: RowGrams, second: RowGrams) -> RowGrams:
    """Products of one row over the logs of both arguments."""
    joined = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ("b", "c", "core_a", "core_b", "core_c", "count")
    }
    return replace(first, a=first.a + second.a, **joined)
