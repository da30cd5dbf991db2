"""Findings of coarse encoders: derivatives of positions with large steps cause a spurious torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.gap import ResidualSums, residual_sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.noise.encoder_noise import CoarseJoint
from identification.diagnosis.result import Finding, Value
from identification.engine.claims import GateResult
from identification.gates.coarse_reading import rounding_matters
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class CoarseRounding:
    """Joints with coarse encoders whose rounding matters, and the spurious torque that the rounding causes.

    Attributes:
        coarse: The joints.
        energy: Mean squared spurious torque of each coarse encoder (row) on each joint (column), ``(k, nv)``.
        results: All joints with a coarser encoder than expected, each with the result of the gate `rounding_matters`.
    """

    coarse: tuple[CoarseJoint, ...]
    energy: Float[Array, "k nv"]
    results: tuple[tuple[CoarseJoint, GateResult], ...] = ()

    @property
    def total(self) -> Float[Array, " nv"]:
        """Mean squared spurious torque of all coarse encoders together on each joint, ``(nv,)``."""
        return self.energy.sum(axis=0)


def coarse_rounding(
    problem: Problem,
    coarse: tuple[CoarseJoint, ...],
    floor: Float[Array, " nv"],
    noise: Series,
) -> CoarseRounding:
    """Joints whose rounding is a large part of the noise on some joint, in the judged band or above it.

    Args:
        problem: Recordings and blocks.
        coarse: Joints with a coarser encoder than expected, with the spurious torque of the rounding.
        floor: Noise floor of each joint in the judged band, ``(nv,)``.
        noise: Noise of each log's torque.
    """

    def mean_square(torque: Series) -> Float[Array, " nv"]:
        return residual_sums(problem, torque).rms() ** 2

    results = []
    for one in coarse:
        in_band = mean_square(problem.session.in_judged_band(one.usual_low_pass)) / floor**2
        # The judged band ends where rounding conceals the motion, but rounding may matter above it, too.
        all_frequencies = mean_square(one.usual_low_pass) / np.maximum(mean_square(noise), 1e-300)
        results.append((one, rounding_matters(float(np.max([in_band, all_frequencies])))))
    significant = tuple(one for one, result in results if result.passed)
    energy = [mean_square(problem.session.in_judged_band(one.torque)) for one in significant]
    return CoarseRounding(significant, np.array(energy).reshape(len(significant), len(floor)), tuple(results))


def coarse_findings(
    robot: Robot, rounding: CoarseRounding, within: ResidualSums, floor: Float[Array, " nv"]
) -> tuple[Finding, ...]:
    """A finding for each joint with a coarse encoder whose rounding matters.

    Args:
        robot: The given model.
        rounding: The joints and their spurious torque.
        within: Residual of the model adjusted within its tolerances.
        floor: Noise floor of each joint, ``(nv,)``.
    """
    effect = effect_named("encoder_quantization")
    gap = max(float(np.mean(within.rms() ** 2 / floor**2)) - 1.0, 1e-9)
    out = []
    for one, energy in zip(rounding.coarse, rounding.energy, strict=True):
        joint = robot.joint_names[one.row]
        closed = float(min(np.mean(energy / floor**2) / gap, 1.0))
        # The squared torque of rounding errors has a relative standard deviation of about sqrt(2 / samples).
        spread = 2.0 * closed / np.sqrt(max(within.counts.sum() / len(floor), 1.0))
        unit = effect.parameters(robot, joint)[0].unit
        # The step is known almost exactly: a hundredth of a step is a safe standard deviation.
        step = Value(one.step, 0.01 * one.step, unit)
        interval = (max(closed - spread, 0.0), min(closed + spread, 1.0))
        out.append(
            Finding(
                effect.name,
                joint,
                effect.regime,
                parameters={"step": step},
                gap_closed=closed,
                gap_closed_interval=interval,
                probability=1.0,
                rivals=(),
                verdict="supported",
                share=closed,
            )
        )
    return tuple(out)
