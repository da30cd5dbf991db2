"""Finds torques that were recorded without their sign, as some drives report only the magnitude of current or load."""

from __future__ import annotations

import numpy as np

from identification.data.checks.against_model import regress_torque
from identification.data.checks.readings.reading import Reading, varies
from identification.data.recording import Fault, Recording
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import listed

# The model needs torques of both signs if the modelled torque exceeds the first share of its root mean square, in each
# direction, for more than the second share of the time.
_STRONG, _STRONG_SHARE = 0.3, 0.1
# Largest share of the time for which a torque that is logged with the sign of the velocity may oppose the velocity:
# both are filtered, so near a reversal their signs may differ.
_NEVER = 0.01
# If the filtered sign of the velocity is above this magnitude, the velocity had this sign at practically all samples in
# the filter.
_SURE = 0.9
# A torque is fitted as a magnitude and as a signed torque. It is certainly a magnitude if the unexplained share as a
# magnitude is below the first number, and below the second number times the unexplained share as a signed torque. It is
# probably a magnitude if the ratio of these shares is below the third number.
_RIGHT, _CERTAIN, _LIKELY = 0.15, 0.25, 0.8
# Number of rounds in which the signs and the coefficients of a magnitude are fitted in turn.
_ROUNDS = 10


def unsigned_fault(recording: Recording, reading: Reading, needed: Float[Array, "N nv"]) -> Fault | None:
    """The fault of torques that are magnitudes: never negative, and equal to the modelled torque without its sign.

    Args:
        recording: Raw samples.
        reading: Smoothed samples of the recording.
        needed: Torque of the model without friction at the same samples [N m or N].
    """
    found = _magnitudes(reading, needed, _one_sign(recording, reading, needed), np.ones_like(needed))
    if not found:
        return None
    names, several = listed([recording.joint_names[j] for j in found]), len(found) > 1
    left_as_signed, left_as_magnitude = max(found.values())
    return Fault(
        f"the torque{'s' * several} of {names} {'have' if several else 'has'} no sign",
        f"the motion needs torques of both signs, {'these are' if several else 'this is'} never negative; as a signed "
        f"torque {100 * left_as_signed:.0f} % of it is left unexplained, as a magnitude "
        f"{max(100 * left_as_magnitude, 0.1):.2g} %",
        "record the torque with its sign: it cannot be put back with certainty where the torque passes zero",
    )


def _magnitudes(
    reading: Reading, needed: Float[Array, "N nv"], possible: Bool[Array, " nv"], logged_sign: Float[Array, "N nv"]
) -> dict[int, tuple[float, float]]:
    """Joints whose torques are magnitudes, with their unexplained shares as signed torques and as magnitudes.

    Args:
        reading: Smoothed samples of the recording.
        needed: Torque of the model without friction at the same samples [N m or N].
        possible: Joints that are tested.
        logged_sign: Sign that the log gives the magnitudes, filtered as they are.
    """
    out, certain = dict[int, tuple[float, float]](), False
    for j in np.flatnonzero(possible & varies(reading.tau)).tolist():
        rows = np.abs(logged_sign[:, j]) > _SURE  # elsewhere the filter has mixed torques of both signs
        columns = np.column_stack([needed[:, j], reading.motion.v[:, j], reading.sign[:, j], np.ones(len(needed))])
        columns, tau, sign = columns[rows], reading.tau[rows, j], np.sign(logged_sign[rows, j])
        # The signs of the first round are those of the model's torque; each later round takes the signs of the fit
        # before it.
        x = np.array([1.0, 0.0, 0.0, 0.0])
        for _ in range(_ROUNDS):
            x = np.linalg.lstsq(columns * (np.sign(columns @ x) * sign)[:, None], tau, rcond=1e-9)[0]
        left_as_magnitude = float(np.mean((tau - np.abs(columns @ x) * sign) ** 2) / tau.var())
        left_as_signed = _mean_square(columns, tau) / float(tau.var())
        if x[0] > 0 and left_as_magnitude < min(_RIGHT, _LIKELY * left_as_signed):
            out[j] = left_as_signed, left_as_magnitude
            certain = certain or left_as_magnitude < _CERTAIN * left_as_signed
    # If one joint is certain, the joints that are only probable count as well: the same drives log them.
    return out if certain else {}


def check_unsigned(recording: Recording, data: Reading, model: Float[Array, "N nv"]) -> tuple[str, ...]:
    """Warnings on torques that look like magnitudes: they lack a sign that the model needs.

    Such torques are never negative. If the log gives magnitudes the sign of the velocity, they are never against the
    velocity. The latter is no certain fault, because self-locking gears need such torques, too.

    Args:
        recording: Raw samples.
        data: Smoothed samples of the recording.
        model: Torque of the model without friction at the same samples [N m or N].
    """
    out = []
    never_negative = _one_sign(recording, data, model)
    for j in np.flatnonzero(never_negative):
        v, sign, tau = data.motion.v[:, j], data.sign[:, j], np.abs(data.tau[:, j])
        as_signed = regress_torque(model[:, j], v, sign, tau)
        as_magnitude = regress_torque(np.abs(model[:, j]), v, sign, tau)
        if as_signed is None or as_magnitude is None:
            continue
        if as_magnitude.unexplained < _LIKELY * as_signed.unexplained:
            out.append(
                f"{recording.file}: the torque of {recording.joint_names[j]} is never negative although its motion "
                "needs both signs: it looks like a magnitude; record it with its sign."
            )
    along = _magnitudes(data, model, _along_velocity(data, model) & ~never_negative, data.sign)
    if along:
        names, several = listed([recording.joint_names[j] for j in along]), len(along) > 1
        out.append(
            f"{recording.file}: the torque{'s' * several} of {names} never brake{'s' * (not several)} the motion, as "
            "the weight of the links needs: either the log gives magnitudes the sign of the velocity, and what is "
            "found there is wrong, or the gears lock themselves, as worms and screws do; record the torque with its "
            "own sign."
        )
    return tuple(out)


def _one_sign(recording: Recording, data: Reading, model: Float[Array, "N nv"]) -> Bool[Array, " nv"]:
    """True for joints that reverse, and whose torque is never negative although the model needs both signs."""
    if recording.tau is None:
        return np.zeros(model.shape[1], dtype=bool)
    strong = _STRONG * np.sqrt(np.mean(model**2, axis=0))
    both = np.minimum(np.mean(model > strong, axis=0), np.mean(model < -strong, axis=0)) > _STRONG_SHARE
    turns = np.ptp(np.sign(data.motion.v), axis=0) == 2
    positive = (recording.tau.min(axis=0) >= 0) & (recording.tau.max(axis=0) > 0)
    return both & turns & positive


def _along_velocity(data: Reading, model: Float[Array, "N nv"]) -> Bool[Array, " nv"]:
    """True for joints whose strong torques never oppose the velocity, although the model needs torques that do.

    Drives that report a magnitude are often logged with the sign of the velocity.
    """
    fast = np.abs(data.motion.v) > _STRONG * np.sqrt(np.mean(data.motion.v**2, axis=0))

    def brakes(torque: Float[Array, "N nv"]) -> Float[Array, " nv"]:
        """Share of the samples in which a strong torque is against a fast motion."""
        strong = np.abs(torque) > _STRONG * np.sqrt(np.mean(torque**2, axis=0))
        return np.mean(fast & strong & (torque * data.motion.v < 0), axis=0)

    return (brakes(model) > _STRONG_SHARE) & (brakes(data.tau) < _NEVER)


def _mean_square(columns: Float[Array, "N k"], target: Float[Array, " N"]) -> float:
    """Mean squared residual of a least-squares fit of ``columns`` to ``target``."""
    return float(np.mean((target - columns @ np.linalg.lstsq(columns, target, rcond=1e-9)[0]) ** 2))
