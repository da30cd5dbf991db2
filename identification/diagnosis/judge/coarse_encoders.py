"""Findings of coarse encoders: their readings lie on a lattice of equal steps, and rounding makes a spurious torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.gap import ResidualSums, residual_sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.noise.encoder_noise import Coarse
from identification.diagnosis.result import Finding, Value
from identification.engine.claims import GateResult
from identification.gates.coarse_reading import rounding_matters
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class CoarseRounding:
    """Coarse joints whose rounding matters, and the squared spurious torque that it makes.

    Attributes:
        coarse: The joints.
        energy: For each of them the mean squared torque on every joint, ``(k, nv)``.
        results: All joints with a coarser encoder than expected, each with the result of the gate `rounding_matters`.
    """

    coarse: tuple[Coarse, ...]
    energy: Float[Array, "k nv"]
    results: tuple[tuple[Coarse, GateResult], ...] = ()

    @property
    def total(self) -> Float[Array, " nv"]:
        """Mean squared torque of all coarse encoders together on each joint."""
        return self.energy.sum(axis=0)


def coarse_rounding(
    problem: Problem,
    coarse: tuple[Coarse, ...],
    floor: Float[Array, " nv"],
    noise: Series,
) -> CoarseRounding:
    """Coarse joints whose rounding makes much of the noise on some joint, in the judged band or above it."""
    results, energy = [], []
    for one in coarse:
        squares, squares_usual_low_pass = (
            residual_sums(problem, problem.session.in_judged_band(torque)).rms() ** 2
            for torque in (one.torque, one.usual_low_pass)
        )
        # The judged band ends where rounding hides the motion: rounding may still matter above that band.
        wide = residual_sums(problem, one.usual_low_pass).rms() ** 2 / np.maximum(
            residual_sums(problem, noise).rms() ** 2, 1e-300
        )
        result = rounding_matters(float(np.max([squares_usual_low_pass / floor**2, wide])))
        results.append((one, result))
        energy += [squares] if result.passed else []
    kept = tuple(one for one, result in results if result.passed)
    return CoarseRounding(kept, np.array(energy).reshape(len(kept), len(floor)), tuple(results))


def coarse_findings(
    robot: Robot, rounding: CoarseRounding, within: ResidualSums, floor: Float[Array, " nv"]
) -> tuple[Finding, ...]:
    """One finding for each coarse joint."""
    effect = effect_named("encoder_quantization")
    gap = max(float(np.mean(within.rms() ** 2 / floor**2)) - 1.0, 1e-9)
    out = []
    for one, energy in zip(rounding.coarse, rounding.energy, strict=True):
        joint = robot.joint_names[one.row]
        closed = float(min(np.mean(energy / floor**2) / gap, 1.0))
        # The energy of rounding errors, uniformly distributed, has a relative deviation of about sqrt(2 / samples).
        spread = 2.0 * closed / np.sqrt(max(within.counts.sum() / len(floor), 1.0))
        unit = effect.parameters(robot, joint)[0].unit
        # Distances of levels are exact up to rounding of numbers; a hundredth of a step is a safe deviation.
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
