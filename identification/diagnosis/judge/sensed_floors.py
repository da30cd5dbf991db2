"""Noise floor of each joint by what its sensors make, in place of what flexible predictors do not foresee.

An upper limit proves no null: what predictors miss holds the effect that is looked for. They are kept for joints whose
noise no sensor shows, with the source ``none``, and nothing is called free of a gap by them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.gap import judged_blocks, measured_torque, sample_weights, sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.floors import REPETITIONS, Floor, left_in_doubt
from identification.diagnosis.noise.discrepancy import discrepancy
from identification.diagnosis.noise.sensor_floor import sensor_floor
from identification.engine import contract_levels
from phantom_dyn.array_types import Float

Array = np.ndarray

SENSORS, NONE = "sensors", "none"


def sensed_floor(
    floor: Floor,
    problem: Problem,
    noise: Series,
    residual: Series,
    doubt: Series,
) -> Floor:
    """The floor of each joint by its sensors, with the discrepancy that a sound model is allowed.

    Repetitions stay what they are. Where predictors leave less than the sensors make, the noise is known and no more
    than that. The upper end holds what is left where friction is in doubt, and what derivatives
    and filters are wrong by.

    Args:
        floor: By repetitions and predictors.
        problem: Recordings, blocks and columns.
        noise: What no predictor foresees of each log's torque.
        residual: What the explanation leaves of each log's torque, in the judged band.
        doubt: Variance of the friction torque that joints leave open which stand, creep or turn about.
    """
    from scipy.special import ndtri

    session, torque = problem.session, sums(problem, measured_torque(problem)).rms()
    joints = len(torque)
    usable = counted(problem)
    deviations = float(ndtri(1.0 - 0.5 * rules.FLOOR_ERROR / joints))
    sensed = sensor_floor(session, usable, deviations)
    repeated = np.array([source == REPETITIONS for source in floor.source])
    known = sensed.known & ~repeated
    taken = known & (sensed.value < floor.value)
    # Where both agree, predictors say more closely what it is: encoders may hide all that the torque holds.
    agree = (floor.value >= sensed.low) & (floor.value <= sensed.high)
    value, low, high = (
        np.where(use, own, given)
        for use, own, given in (
            (taken & ~agree, sensed.value, floor.value),
            (taken, sensed.low, floor.low),
            (taken, sensed.high, floor.high),
        )
    )
    high = np.where(taken, np.hypot(high, rules.MODEL_SHARE * torque), high)
    wide = np.maximum(high / value, contract_levels.FLOORS_LEFT)
    open_ = left_in_doubt(problem, session.in_judged_band(noise), residual, doubt, value, wide)
    high = np.where(taken, np.sqrt(high**2 + open_), high)
    source = tuple(
        REPETITIONS if again else SENSORS if own else NONE for again, own in zip(repeated, known, strict=True)
    )
    return replace(
        floor, value=value, low=low, high=high, source=source, discrepancy=discrepancy(session, usable, torque)
    )


def counted(problem: Problem) -> tuple[Float[Array, "n nv"], ...]:
    """What each sample of each log counts in the figures of a gap: nothing outside the cores of the judged blocks."""
    out = tuple(np.zeros(use.shape) for use in problem.columns.usable)
    for k in judged_blocks(problem):
        block = problem.blocks[k]
        part = slice(block.core, block.stop)
        out[block.log][part] = sample_weights(problem, block.log, part)
    return out
