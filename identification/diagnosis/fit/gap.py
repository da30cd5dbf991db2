"""Residuals of corrected models, their loss, and the gap of each joint.

A corrected model is the given model with the effects of a fit and its changes within tolerances. Its loss is the mean
over joints of squared residual over squared noise floor. The gap of a row (one joint's torque) is the weighted sum of
squared residuals minus the sum that noise alone would give. Residuals are compared in the judged band, the lower part
of the frequency band of the fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.motion.standstill import noise_share
from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.fitting import Fitted, predict
from identification.diagnosis.fit.problem import Problem
from identification.gates import fair_part
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class ResidualSums:
    """Squared residuals and numbers of samples, by block and joint, over the cores of the judged blocks.

    The core of a block is the part whose filtered noise is independent of the block before. Blocks without samples are
    left out, because a bootstrap replicate of such blocks alone would be empty. Samples at standstill have a low
    weight, because static friction is hardly known there.

    Attributes:
        squares: Weighted sums of squared residuals [(N m)^2 or N^2], ``(B, nv)``.
        counts: Weighted numbers of samples, ``(B, nv)``.
    """

    squares: Float[Array, "B nv"]
    counts: Float[Array, "B nv"]

    def rms(self) -> Float[Array, " nv"]:
        """Root mean square residual of each joint [N m or N]."""
        return np.sqrt(self.squares.sum(axis=0) / np.maximum(self.counts.sum(axis=0), 1))

    def loss(self, floor: Float[Array, " nv"], weights: Float[Array, "R B"]) -> Float[Array, " R"]:
        """Mean over joints of squared residual over squared noise floor, with each block counted ``weights`` times.

        Args:
            floor: Noise floor of each joint [N m or N].
            weights: Number of times that each block counts; one row for each loss.

        Returns:
            One loss per row of ``weights``.
        """
        mean = (weights @ self.squares) / np.maximum(weights @ self.counts, 1e-12)
        return (mean / floor**2).mean(axis=1)


def judged_blocks(problem: Problem) -> Array:
    """Indices of the blocks of held-out recordings if there are any, else of all blocks.

    Each of these blocks is predicted by a fit to other blocks.
    """
    outside = np.flatnonzero(problem.grams.fold < 0)
    return outside if len(outside) else np.arange(len(problem.blocks))


def held_out_torque(problem: Problem, chosen: frozenset[Term], found: Fitted) -> tuple[Float[Array, "n nv"], ...]:
    """Torque of the corrected model on every log [N m or N], each block by a fit to other blocks."""
    terms = ordered(chosen)
    out = [np.array(torque) for torque in problem.columns.model_torque]
    fold_theta = found.fold_theta
    for block, fold in zip(problem.blocks, problem.grams.fold, strict=True):
        part = slice(block.start, block.stop)
        theta = found.theta if fold < 0 else fold_theta[fold]
        out[block.log][part] = predict(found.problem, terms, theta, block.log, part)
    return tuple(out)


def residual_sums(problem: Problem, residual: tuple[Float[Array, "n nv"], ...]) -> ResidualSums:
    """Squared residuals and numbers of samples of the judged blocks."""
    blocks = (problem.blocks[k] for k in judged_blocks(problem))
    parts = [(block.log, slice(block.core, block.stop)) for block in blocks]
    weights = [sample_weights(problem, *part) for part in parts]
    counts = np.array([use.sum(axis=0) for use in weights])
    squares = [(residual[log][part] ** 2 * use).sum(axis=0) for (log, part), use in zip(parts, weights, strict=True)]
    # If all blocks are empty, none is left out.
    filled = counts.any(axis=1) | ~counts.any()
    return ResidualSums(np.array(squares)[filled], counts[filled])


def sample_weights(problem: Problem, log: int, part: slice = slice(None)) -> Float[Array, "n nv"]:
    """Weight of each sample of a part of one log; lower at standstill, where static friction has an unknown size."""
    columns = problem.columns
    return columns.usable[log][part] * noise_share(problem.weights.floor**2, columns.standstill_std[log][part] ** 2)


def least_noise(columns: Columns) -> Float[Array, " nv"]:
    """Lower limit of each joint's noise: a millionth of the standard deviation of its modelled torque, ``(nv,)``."""
    return np.maximum(1e-6 * np.concatenate(columns.model_torque).std(axis=0), 1e-12)


def residual_after(problem: Problem, torque: tuple[Float[Array, "n nv"], ...]) -> tuple[Float[Array, "n nv"], ...]:
    """Measured minus predicted torque of every log [N m or N]."""
    columns = problem.columns
    return tuple(
        residual + model - predicted
        for residual, model, predicted in zip(columns.residual, columns.model_torque, torque, strict=True)
    )


def measured_torque(problem: Problem) -> tuple[Float[Array, "n nv"], ...]:
    """Torque of every log in the judged band with which gaps are compared: the measured one if the joint has a drive.

    For a joint without a drive it is the torque that accelerates the joint's own inertia (`comparison_torque`).
    """
    return problem.session.in_judged_band(measured_in_fit_band(problem))


def measured_in_fit_band(problem: Problem) -> tuple[Float[Array, "n nv"], ...]:
    """Torque of every log as in `measured_torque`, but in the wider band of the fits."""
    columns = problem.columns
    torque = tuple(model + residual for model, residual in zip(columns.model_torque, columns.residual, strict=True))
    return comparison_torque(problem, torque)


def comparison_torque(problem: Problem, torque: tuple[Float[Array, "n nv"], ...]) -> tuple[Float[Array, "n nv"], ...]:
    """Torque with which the residual of each joint is compared, for each log [N m or N], ``(n, nv)``.

    For a joint with a drive, it is the given torque. A joint without a drive is moved by gravity and the other links:
    its measured torque is zero, and its residual is the negative of its modelled torque, so neither shows whether the
    residual is small. For such a joint, it is the torque that accelerates the joint's own inertia.

    Args:
        problem: Robot and recordings.
        torque: Measured or modelled torque of every log in the band of the fits [N m or N].
    """
    session, out = problem.session, tuple(np.array(own) for own in torque)
    for row, actuator in enumerate(session.robot.actuators):
        if not actuator.actuated:
            for log, own in zip(session.logs, out, strict=True):
                own[:, row] = log.band(_inertia_torque(session.robot, log.motion, row))
    return out


def _inertia_torque(robot: Robot, motion: Motion, row: int) -> Float[Array, " N"]:
    """Torque that accelerates a joint if the other joints do not move [N m or N]."""
    zero, a = np.zeros_like(motion.v), np.zeros_like(motion.a)
    a[:, row] = motion.a[:, row]
    accelerated, at_rest = (inverse_dynamics(robot, motion.with_joints(motion.q, zero, each)) for each in (a, zero))
    return accelerated[:, row] - at_rest[:, row]


def row_counts(problem: Problem) -> Float[Array, " nv"]:
    """Effective number of samples on each row, over the cores of all blocks."""
    return np.array([row.count.sum() for row in problem.grams.rows])


@dataclass(frozen=True)
class RowGaps:
    """Gap of each row: squared residuals over squared noise, summed over samples, minus the sum from noise alone.

    An effect is claimed only if it explains a share of the gap.

    Attributes:
        gap: Gap of the given model after a fit of its tolerance parameters, ``(nv,)``.
        accuracy: Gap that errors of the method may cause, ``(nv,)``.
    """

    gap: Float[Array, " nv"]
    accuracy: Float[Array, " nv"]


def row_gaps(problem: Problem, tolerance_fit: Fitted) -> RowGaps:
    """Gaps of each row, with the weights and in the band of a fitting problem.

    Args:
        problem: Columns and their products.
        tolerance_fit: Fit of the tolerance parameters alone.
    """
    # Squared residuals of the given model before any fit; those after the fit of its tolerances are `row_losses`.
    of_given_model = np.array([row.core_c.sum() for row in problem.grams.rows])
    given, gap = (np.maximum(loss - row_counts(problem), 0.0) for loss in (of_given_model, tolerance_fit.row_losses))
    return RowGaps(gap, fair_part.ACCURACY * given)
