"""Samples in which friction is uncertain: standstill, which is left out, and reversals, which get a low weight.

At standstill static friction may balance any torque, so fits do not use these samples. At a reversal a friction law
jumps. A real joint sticks for some milliseconds, or bends before it slides, so its friction changes sign earlier or
later. In recordings with little noise the difference looks like a delayed torque. While the reading of an encoder does
not change, friction may have any value between plus and minus the breakaway torque of the joint.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy import ndimage

from identification.data.derivatives import motion_edge, position_edges
from identification.data.log import Band, Log
from identification.diagnosis import decision_rules as rules
from phantom_dyn._kernels.fir import filtered
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import modelled_friction
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.encoder_lattice import stated_step
from phantom_dyn.model.robot import Robot

# Orders of the differences from which the noise of readings is estimated, and the least number of samples for that.
_ORDERS, _LEAST_ROWS = (3, 5, 8, 11), 60
# The noise of readings is used only if a joint travels farther than both: the first in rad or m, the second in standard
# deviations of its readings. A joint held by its drive may sag by less, slowly and without noise.
_LEAST_WAY, _BEYOND_SHAKE = 1e-3, 50.0
# The direction of a slow joint counts as hidden by its encoder under three conditions (`direction_hidden`): over this
# time [s], its net travel as a share of its path exceeds the mean sign of its velocity by more than the second number,
# and the path is less than the third number of encoder counts. A velocity that rises steadily through zero reaches at
# most 0.3.
_WATCHED, _HIDDEN, _COUNTS = 0.25, 0.3, 8.0
# Factor by which the noise is assumed to be larger than the estimate for white noise, as it is not white.
_CAUTION = 3.0
# A residual at a short stop counts as held by friction from this multiple of the usual residual in motion on.
_HELD = 2.0
# A sample of the band is used if its share of standstill, weighted by the filter's kernel, is below this. A quarter of
# the kernel at either end has this weight.
_STANDING = 0.055


def standing_still(log: Log) -> Bool[Array, "N nv"]:
    """True where a joint is at standstill: its speed is within noise, so static friction may hold any torque.

    The threshold is three sigmas of the velocity minus its short moving average in the quietest fifth of the recording,
    where the motion itself adds nothing, and at least a thousandth of the joint's top speed. A joint may vibrate while
    it travels, for example with backlash; then the moving average itself is compared with the threshold. If coarse
    readings required a lower low pass, a joint is at standstill if it moves less than a step in a period of its edge.
    """
    width = max(3, int(log.band.rate_hz / log.band.cutoff_hz))
    kernel = np.ones(width) / width
    out, hidden_speeds = np.empty(log.motion.v.shape, dtype=bool), _speeds_below_a_step(log)
    for j in range(log.motion.q.shape[1]):
        q, v = log.motion.q[:, j], log.motion.v[:, j]
        # A total motion of less than a millionth of a radian or metre is rounding errors.
        moves = np.ptp(q) > 1e-6
        sigma = _noise(v, kernel)
        if sigma > rules.SHAKES * np.percentile(np.abs(v), 95):
            # A joint that moves all the time has no quiet fifth. Then the noise is estimated from the readings.
            sigma = min(sigma, _noise_of_readings(log, j))
        noise_only = bool(np.percentile(np.abs(v), 95) < 5 * sigma)
        if noise_only and moves and _travels(q, kernel):
            v = np.convolve(v, kernel, mode="same")
            sigma, noise_only = _noise(v, kernel), False
        slow = np.abs(v) < max(3 * sigma, 1e-3 * np.percentile(np.abs(v), 99), hidden_speeds[j])
        # Passing through zero is no standstill: the joint has to be slow for a whole period of the band's edge.
        at_standstill = np.convolve(slow, kernel, mode="same") > 0.999
        # If even the fastest speeds of a joint are noise, it is at standstill all the time.
        held = not moves or noise_only
        out[:, j] = (np.convolve(at_standstill, np.ones(width), mode="same") > 0.5) | held
    return out


def _speeds_below_a_step(log: Log) -> Float[Array, " nv"]:
    """Speed [rad/s or m/s] at which a joint moves one encoder step in a period of its low pass.

    It is zero if the encoder is so fine that the low pass was not lowered for it.
    """
    edges = np.broadcast_to(position_edges(log), log.motion.q.shape[1])
    steps = np.array([step or 0.0 for step in log.reading_steps] or np.zeros(len(edges)))
    return np.where(edges < motion_edge(log.band), steps * edges, 0.0)


def _noise(v: Float[Array, " N"], kernel: Float[Array, " w"]) -> float:
    """Root mean square of a series minus its moving average, in its quietest fifth."""
    width = len(kernel)
    rough = v - np.convolve(v, kernel, mode="same")
    windows = rough[: len(rough) // width * width].reshape(-1, width)
    return float(np.percentile(np.sqrt(np.mean(windows**2, axis=1)), 20)) if len(windows) else 0.0


def _noise_of_readings(log: Log, j: int) -> float:
    """Standard deviation of the speed [rad/s or m/s] in the band due to white noise of a joint's raw readings.

    It is infinite if the joint hardly travels farther than the noise of its readings. Differences of high order remove
    the motion even if its period has few samples; the order with the smallest result is used.
    """
    if log.raw_q is None or int(log.valid.sum()) < _LEAST_ROWS:
        return np.inf
    q = log.raw_q[log.valid, j]
    least = min(
        1.4826 * float(np.median(np.abs(np.diff(q, order)))) / np.sqrt(float(math.comb(2 * order, order)))
        for order in _ORDERS
    )
    step = (log.reading_steps[j] if len(log.reading_steps) > j else None) or 0.0
    shakes = max(least, step / np.sqrt(12), 1e-12)
    if np.ptp(q) < max(_LEAST_WAY, _BEYOND_SHAKE * shakes):
        return np.inf
    return float(_CAUTION * 2 * np.pi * shakes * np.sqrt(2 * log.band.cutoff_hz**3 / (3 * log.band.rate_hz)))


def _travels(q: Float[Array, " N"], kernel: Float[Array, " w"]) -> bool:
    """True if a joint travels much farther than the noise of its readings."""
    if len(q) < 4 * len(kernel):
        return False
    smooth = np.convolve(q, kernel, mode="valid")
    rough = q[len(kernel) // 2 :][: len(smooth)] - smooth
    return bool(np.ptp(smooth) > rules.TRAVELS * rough.std())


def usable_samples(log: Log) -> Bool[Array, "n nv"]:
    """In-band samples whose filter kernel covers no excluded sample, no contact, and hardly any standstill.

    Standstill is weighted by the kernel. A kernel may be longer than a second, for example for a log of 50 Hz. Then a
    joint that moves from point to point is always at standstill somewhere near the ends of the kernel.
    """
    weights = np.abs(log.band.kernel)
    share = filtered(weights / weights.sum(), standing_still(log).astype(float), log.band.step)
    return (share < _STANDING) & log.valid_in_band[:, None] & log.untouched_in_band


def reversal_std(operation: Operation) -> Float[Array, "N nv"]:
    """Standard deviation of the modelled torque near reversals, from the time derivative of its Coulomb friction.

    It has the sign of the derivative, because it is then filtered as the torque is.
    """
    friction = operation.own_friction
    # Viscous friction doubles with the velocity, Coulomb friction does not.
    coulomb = 2.0 * friction - modelled_friction(operation.robot, replace(operation, v=2.0 * operation.v))
    return rules.REVERSAL_TIME * np.gradient(coulomb, operation.dt, axis=0)


def encoder_still(robot: Robot, log: Log) -> Bool[Array, "N nv"]:
    """True where a joint's encoder shows no motion: its reading stays within about two counts for some time.

    A reading between two levels flickers by one count, and a motion that ends there adds another. The result is False
    for a joint with an encoder so coarse that slow motion looks the same. If no count is known, only a reading that
    does not change at all shows no motion.
    """
    readings = log.motion.q if log.raw_q is None else log.raw_q
    rate = log.band.rate_hz
    out = np.zeros(readings.shape, dtype=bool)
    for j in range(readings.shape[1]):
        most = rules.STANDING_COUNTS * counted_step(robot, log, j)
        speed = np.abs(log.motion.v[:, j])
        # Median speed while the joint moves, as many joints rest for most of a recording.
        usual = float(np.median(speed[speed >= rules.CREEPING_SPEED * np.percentile(speed, 99)]))
        if usual == 0.0:
            continue
        # The coarser the encoder, the longer a reading has to stay the same to rule out slow motion.
        seconds = max(rules.STANDING_TIME, most / (rules.STANDING_SPEED * usual))
        if seconds > rules.STANDING_LONGEST:
            continue
        width = max(3, 2 * round(0.5 * seconds * rate) + 1)
        q = readings[:, j]
        travel = ndimage.maximum_filter1d(q, width) - ndimage.minimum_filter1d(q, width)
        # All samples of a window within which the reading hardly changes.
        out[:, j] = ndimage.maximum_filter1d(travel <= most, width)
    return out


def friction_sign_unknown(robot: Robot, log: Log) -> Bool[Array, "N nv"]:
    """True where the sign of friction is unknown: a joint's encoder shows no motion, or not the direction of motion."""
    steps = np.array([counted_step(robot, log, j) for j in range(robot.nv)])
    return encoder_still(robot, log) | direction_hidden(log, steps)


def direction_hidden(log: Log, steps: Float[Array, " nv"]) -> Bool[Array, "N nv"]:
    """True where a joint moves some counts in one direction while its computed velocity keeps changing sign.

    The reading of a slow joint with a coarse encoder jumps from count to count, and between two counts the velocity
    seems to be zero or negative. The sign of the modelled friction is then uncertain. The joint has to move like this
    before and after the sample, so starts and reversals are excluded.

    Args:
        log: The recording.
        steps: Step of each joint's readings [rad or m] (`counted_step`); zero where it is not known.
    """
    v = log.motion.v
    width = max(3, round(_WATCHED * log.band.rate_hz))
    path, net, sign = (
        ndimage.uniform_filter1d(part, width, axis=0, mode="nearest") for part in (np.abs(v), v, np.sign(v))
    )
    hidden = (np.abs(net) > (np.abs(sign) + _HIDDEN) * path) & (path * _WATCHED < _COUNTS * steps)
    half = width // 2
    padded = np.pad(hidden, ((half, half), (0, 0)), mode="edge")
    return padded[: len(v)] & padded[2 * half :]


def counted_step(robot: Robot, log: Log, row: int) -> float:
    """Step [rad or m] of a joint's readings, or the stated step of its encoder if that is larger; zero if unknown.

    Args:
        robot: States the steps of its encoders.
        log: A recording, with the steps of its readings.
        row: Index of the joint.
    """
    seen = log.reading_steps[row] if log.reading_steps else None
    return max(seen or 0.0, stated_step(robot, row) or 0.0)


def standstill_std(log: Log, stands: Bool[Array, "N nv"], friction: Float[Array, "N nv"]) -> Float[Array, "n nv"]:
    """Standard deviation of the friction torque, in the band, of joints that stand still.

    At standstill the model's friction is ``T`` or ``-T``, with the sign of noise. The true friction is assumed to be
    uniform between ``-T`` and ``T``. The difference then has the mean square ``T^2 + T^2 / 3``.

    Args:
        log: The recording, for its band.
        stands: True where the reading of a joint does not change.
        friction: Friction torque of the model, findings included.
    """
    return _after_filter(log, np.sqrt(4.0 / 3.0) * np.where(stands, _largest_nearby(log, friction), 0.0))


def held_std(robot: Robot, log: Log, residual: Float[Array, "n nv"]) -> Float[Array, "n nv"]:
    """Standard deviation, in the band, of what friction that the model lacks may hold during short stops of a joint.

    In stick-slip a joint stops for less than a period of the band's edge, so that `usable_samples` keeps the samples.
    Static friction then holds several times the friction of the motion. It is not known, but it holds no more than the
    part of the residual that is larger than twice the usual residual in motion.

    Args:
        robot: States the steps of the encoders.
        log: The recording.
        residual: Residual of the given model, in the band.
    """
    still, size = encoder_still(robot, log), np.abs(residual)
    time, held = np.arange(len(still)), np.zeros(still.shape)
    for j in range(robot.nv):
        moving = size[~still[log.samples, j], j]
        usual = float(np.median(moving)) if len(moving) else np.inf
        held[:, j] = np.interp(time, log.samples, np.where(size[:, j] > _HELD * usual, size[:, j], 0.0))
    return _after_filter(log, np.where(still & ~standing_still(log), held, 0.0))


def creeping_std(log: Log, friction: Float[Array, "N nv"]) -> Float[Array, "n nv"]:
    """Standard deviation of the friction torque, in the band, of joints that creep or reverse.

    Friction laws are inaccurate there. The error recurs with the motion, so it must not count as an event.

    Args:
        log: The recording.
        friction: Friction torque of the model, findings included.
    """
    v = log.motion.v
    slow = np.abs(v) < rules.CREEPING_SPEED * np.percentile(np.abs(v), 99, axis=0)
    reach = 2 * max(1, round(rules.CREEPING_TIME * log.band.rate_hz)) + 1
    creeps = np.logical_or(slow, ndimage.maximum_filter1d(_after_reversals(v), reach, axis=0))
    return _after_filter(log, rules.CREEPING_FRICTION * np.where(creeps, _largest_nearby(log, friction), 0.0))


def uncertain_friction_variance(
    robot: Robot, log: Log, friction: Float[Array, "N nv"], reversals: Float[Array, "n nv"]
) -> Float[Array, "n nv"]:
    """Variance of the friction torque, in the band, of joints that stand still, creep or reverse.

    Args:
        robot: States the steps of the encoders.
        log: The recording.
        friction: Friction torque of the model, findings included.
        reversals: Standard deviation of the friction torque near reversals, in the band (`reversal_std`).
    """
    standing = standstill_std(log, friction_sign_unknown(robot, log), friction)
    return standing**2 + reversals**2 + creeping_std(log, friction) ** 2


def noise_share(noise: Array | float, friction: Array) -> Array:
    """Weight of a sample: variance of the noise over the variance of noise and uncertain friction together.

    Args:
        noise: Variance of the noise.
        friction: Variance of the uncertain friction torque of each sample.
    """
    return noise / np.maximum(noise + friction, 1e-300)


def _largest_nearby(log: Log, friction: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Largest friction torque near each sample: at a reversal the torque of a friction law jumps."""
    reach = 2 * max(1, round(rules.STANDING_TIME * log.band.rate_hz)) + 1
    return ndimage.maximum_filter1d(np.abs(friction), reach, axis=0)


def _after_filter(log: Log, deviation: Float[Array, "N nv"]) -> Float[Array, "n nv"]:
    """Upper limit of a standard deviation after the filter of the band: its sum weighted by the kernel's magnitude."""
    band = log.band
    return Band(band.rate_hz, band.cutoff_hz, np.abs(band.kernel), band.step)(deviation)


def _after_reversals(v: Float[Array, "N nv"]) -> Bool[Array, "N nv"]:
    """True at the first sample after each reversal."""
    return np.vstack([np.zeros((1, v.shape[1]), dtype=bool), np.sign(v[1:]) != np.sign(v[:-1])])


def near_reversals(log: Log) -> Bool[Array, "n nv"]:
    """True for in-band samples near a reversal: within half the reach of the filter, and at least within 50 ms."""
    reach = max(int(0.05 * log.band.rate_hz), log.band.half // 2, 1)
    return ndimage.maximum_filter1d(_after_reversals(log.motion.v), 2 * reach + 1, axis=0)[log.samples]
