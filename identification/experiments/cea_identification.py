"""Simulates the identification of the CEA branch: exciting motion, recording, fit of 16 parameters, test on other data.

In the CEA paper every joint moved in triangles and sines of 0.1 to 2 Hz. The condition number of 15000 equations was
close to 50. Measured and estimated torque were compared on a motion that the fit had not used. `Conditions` holds the
conditions that the paper does not state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.data.derivatives import MOTION_BAND, differentiate
from identification.data.log import Log
from identification.data.signals import low_pass
from identification.excitation.motion_shapes import Sine, Triangle, Wave, wave_motion
from identification.experiments.linear_fit import LinearFit, fit_linear
from phantom_dyn.array_types import Array, Float
from phantom_dyn.devices.cea import GRAVITY, JOINTS, LENGTHS, LinkLengths
from phantom_dyn.devices.cea_dynamics import NAMES, UNITS, VALUES, regressor
from phantom_dyn.motion import Motion

_CANDIDATES = 40  # number of random motions, of which the best is taken; more would hardly lower the condition number


@dataclass(frozen=True)
class Conditions:
    """Conditions of the recording, which the paper does not state.

    Attributes:
        lengths: Lengths of the links.
        gravity: Gravity in frame 0 [m/s^2].
        center: Centre of the motion [rad].
        torque_noise: Standard deviation of the noise of torques [N m].
        encoder_step: Resolution of the positions on the joint side [rad].
        rate_hz: Sample rate.
        cutoff_hz: Cut-off of the low pass that is applied to the torque and to the columns of the regressor [Hz]; ten
            times the frequency of the fastest wave.
        duration: Duration of each recording [s]; 100 s give the 15000 equations of the paper.
    """

    lengths: LinkLengths = LENGTHS
    gravity: tuple[float, float, float] = GRAVITY
    center: tuple[float, float, float] = (0.0, -0.26, -1.83)
    torque_noise: float = 0.05
    encoder_step: float = 1e-4
    rate_hz: float = 200.0
    cutoff_hz: float = 20.0
    duration: float = 100.0


@dataclass(frozen=True)
class CeaIdentification:
    """Result of one simulated identification.

    Attributes:
        fit: The 16 parameters.
        cross_error: Torque error of each active joint on a motion that the fit has not used: RMS of the difference
            divided by RMS of the measured torque [%], shape ``(3,)``.
    """

    fit: LinearFit
    cross_error: Float[Array, " 3"]

    def summary(self) -> str:
        """Table of estimates and true values, condition number, and torque error on the other motion."""
        rows = [
            f"{name:<5} {value:9.5f} +- {std:.5f} {unit:<9} ({relative:6.2f} %)   Table 4 {truth:8.4f}"
            for name, value, std, unit, relative, truth in zip(
                NAMES, self.fit.theta, self.fit.std(), UNITS, self.fit.relative_std(), VALUES, strict=True
            )
        ]
        errors = ", ".join(f"{joint} {error:.2f} %" for joint, error in zip(JOINTS, self.cross_error, strict=True))
        head = f"W is {self.fit.rows} x {len(NAMES)}, condition number {self.fit.condition:.1f}"
        return "\n".join([head, *rows, f"error of the torque on an unseen motion: {errors}"])


def exciting_motion(conditions: Conditions, rng: np.random.Generator) -> Motion:
    """The best conditioned of several random motions, each with one triangle and two sines on every joint.

    Args:
        conditions: Conditions of the recording.
        rng: Random numbers for amplitudes, frequencies (0.1 to 2 Hz) and phases.
    """
    coarse = np.linspace(0.0, min(conditions.duration, 20.0), 500)
    center = np.array(conditions.center)

    def condition(joints: list[tuple[Wave, ...]]) -> float:
        motion = wave_motion(coarse, joints, center)
        W = regressor(motion, lengths=conditions.lengths, gravity=conditions.gravity)
        return float(np.linalg.cond(W.reshape(-1, len(NAMES))))

    best = min([_draw(rng) for _ in range(_CANDIDATES)], key=condition)
    t = np.arange(round(conditions.duration * conditions.rate_hz)) / conditions.rate_hz
    return wave_motion(t, best, center)


def record(
    motion: Motion, conditions: Conditions, rng: np.random.Generator, *, truth: Float[Array, " 16"] = VALUES
) -> Log:
    """Simulated log of a motion, with noise of the torque and positions in encoder steps.

    Args:
        motion: True motion of the device.
        conditions: Device and measurement.
        rng: Random numbers for the noise.
        truth: Parameters of the device in the order of `NAMES`.
    """
    clean = regressor(motion, lengths=conditions.lengths, gravity=conditions.gravity) @ truth
    tau = clean + conditions.torque_noise * rng.normal(size=clean.shape)
    step, rate = conditions.encoder_step, conditions.rate_hz
    measured = np.round(motion.q / step) * step if step else motion.q
    q, v, a = differentiate(measured, rate, min(MOTION_BAND * conditions.cutoff_hz, 0.4 * rate))
    valid = np.ones(len(motion.t), dtype=bool)
    return Log("simulated", JOINTS, Motion(motion.t, q, v, a), tau, low_pass(conditions.cutoff_hz, rate), valid)


def equations(log: Log, conditions: Conditions) -> tuple[Float[Array, "n 3 16"], Float[Array, "n 3"]]:
    """W and Y of equation (3) of the paper: columns and torque in the band of the log.

    Args:
        log: Recording of the device.
        conditions: Link lengths and gravity.
    """
    columns = regressor(log.motion, lengths=conditions.lengths, gravity=conditions.gravity)
    return log.band(columns)[log.valid_in_band], log.band(log.tau)[log.valid_in_band]


def identify(train: Log, test: Log, conditions: Conditions) -> CeaIdentification:
    """The 16 parameters from one log, and their torque error on another log.

    Args:
        train: Log for the fit.
        test: Log for the torque error.
        conditions: Link lengths and gravity.
    """
    W, y = equations(train, conditions)
    # The low pass makes neighbouring samples dependent: one of ``memory`` samples is independent.
    memory = 1 / (train.band.step * np.sum(train.band.kernel**2))
    fit = fit_linear(W.reshape(-1, len(NAMES)), y.reshape(-1), NAMES, UNITS, memory=max(1.0, memory))
    W, y = equations(test, conditions)
    return CeaIdentification(fit, 100 * np.sqrt(np.mean((y - W @ fit.theta) ** 2, axis=0) / np.mean(y**2, axis=0)))


def simulate_identification(
    rng: np.random.Generator, conditions: Conditions = Conditions(), *, truth: Float[Array, " 16"] = VALUES
) -> CeaIdentification:
    """Identification of a simulated device with known parameters, with one motion for the fit and one for the test.

    Args:
        rng: Random numbers for motions and noise.
        conditions: Device and measurement.
        truth: Parameters of the device in the order of `NAMES`.
    """
    train, test = (record(exciting_motion(conditions, rng), conditions, rng, truth=truth) for _ in range(2))
    return identify(train, test, conditions)


def _draw(rng: np.random.Generator) -> list[tuple[Wave, ...]]:
    """Random waves of each joint."""

    def joint() -> tuple[Wave, ...]:
        triangle = Triangle(rng.uniform(0.2, 0.6), rng.uniform(0.1, 0.4), rng.uniform(), turn=0.15)
        return (triangle, *(Sine(rng.uniform(0.05, 0.3), rng.uniform(0.4, 2.0), rng.uniform()) for _ in range(2)))

    return [joint() for _ in JOINTS]
