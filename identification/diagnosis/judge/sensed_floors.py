"""Noise floor of each joint by what its sensors make, in place of what flexible predictors do not foresee.

An upper limit proves no null: what predictors miss holds the effect that is looked for. They are kept for joints whose
noise no sensor shows, with the source ``none``, and nothing is called free of a gap by them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.gap import judged_blocks, measured_torque, sample_weights, sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.floors import REPETITIONS, Floor, left_in_doubt
from identification.diagnosis.noise.discrepancy import discrepancy
from identification.diagnosis.noise.sensor_floor import SensorFloor, sensor_floor
from identification.engine import contract_levels
from phantom_dyn.array_types import Array, Float

SENSORS, NONE = "sensors", "none"


@dataclass(frozen=True)
class Sensed:
    """What does not depend on any effect: the noise of the sensors, and how wrong a sound model may be.

    Attributes:
        floor: What the sensors leave of each joint's torque in the judged band.
        discrepancy: By which a sound model may be wrong on each joint, root mean square, ``(nv,)``.
        torque: Measured torque of each joint in the judged band, root mean square, ``(nv,)``.
    """

    floor: SensorFloor
    discrepancy: Float[Array, " nv"]
    torque: Float[Array, " nv"]


def sensed_of(problem: Problem) -> Sensed:
    """Noise of the sensors in the judged band, and the discrepancy of drives of this class.

    Args:
        problem: Recordings, blocks and columns.
    """
    from scipy.special import ndtri

    torque, usable = sums(problem, measured_torque(problem)).rms(), counted(problem)
    deviations = float(ndtri(1.0 - 0.5 * rules.FLOOR_ERROR / len(torque)))
    session = problem.session
    return Sensed(sensor_floor(session, usable, deviations), discrepancy(session, usable, torque), torque)


def sensed_floor(
    floor: Floor, sensed: Sensed, problem: Problem, noise: Series, residual: Series, doubt: Series
) -> Floor:
    """The floor of each joint by its sensors, with the discrepancy that a sound model is allowed.

    Repetitions stay what they are. Where predictors leave less than the sensors make, the noise is known and no more
    than that. The upper end holds what is left where friction is in doubt, and what derivatives and filters are wrong
    by.

    Args:
        floor: By repetitions and predictors.
        sensed: What the sensors make.
        problem: Recordings, blocks and columns.
        noise: What no predictor foresees of each log's torque.
        residual: What the explanation leaves of each log's torque, in the judged band.
        doubt: Variance of the friction torque that joints leave open which stand, creep or turn about.
    """
    own_floor = sensed.floor
    repeated = np.array([source == REPETITIONS for source in floor.source])
    known = own_floor.known & ~repeated
    taken = known & (own_floor.value < floor.value)
    # Where both agree, predictors say more closely what it is: encoders may hide all that the torque holds.
    agree = (floor.value >= own_floor.low) & (floor.value <= own_floor.high)
    value, low, high = (
        np.where(use, own, given)
        for use, own, given in (
            (taken & ~agree, own_floor.value, floor.value),
            (taken, own_floor.low, floor.low),
            (taken, own_floor.high, floor.high),
        )
    )
    high = np.where(taken, np.hypot(high, rules.MODEL_SHARE * sensed.torque), high)
    wide = np.maximum(high / value, contract_levels.FLOORS_LEFT)
    open_ = left_in_doubt(problem, problem.session.in_judged_band(noise), residual, doubt, value, wide)
    high = np.where(taken, np.sqrt(high**2 + open_), high)
    source = tuple(
        REPETITIONS if again else SENSORS if own else NONE for again, own in zip(repeated, known, strict=True)
    )
    return replace(floor, value=value, low=low, high=high, source=source, discrepancy=sensed.discrepancy)


def counted(problem: Problem) -> tuple[Float[Array, "n nv"], ...]:
    """What each sample of each log counts in the figures of a gap: nothing outside the cores of the judged blocks."""
    out = tuple(np.zeros(use.shape) for use in problem.columns.usable)
    for k in judged_blocks(problem):
        block = problem.blocks[k]
        part = slice(block.core, block.stop)
        out[block.log][part] = sample_weights(problem, block.log, part)
    return out
