r"""Total least squares with the gains of the drives, scaled by a payload of known mass.

Where the torque is a motor's signal times a gain that nobody has measured, every parameter is known up to that gain. A
second recording with a payload whose mass was weighed fixes it: in

.. math:: [W \; w_k \; -V]\,(\theta, 1, g)^T = 0

(:math:`w_k` what the payload needs, :math:`V` one column of the recorded torque for each joint) the solution is the
direction of the smallest singular value, scaled so that the known column counts once. Errors are those of the recorded
torque: the filtered motion has hardly any, so :math:`W` and :math:`w_k` are taken out first, exactly.

References:
    M. Gautier, S. Briot, Global identification of joint drive gains and dynamic parameters of robots, Journal of
    Dynamic Systems, Measurement, and Control 136(5), 2014.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.estimators.fit import Estimate, Fit, Values, fit_of
from identification.estimators.linear.least_squares import base_of, base_rows, factor_of, influence_of
from identification.estimators.linear.scatter import covariances, joint_noise
from identification.regression.base_parameters import BaseParameters, base_parameters_of_matrix
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import IdentifiabilityError, ParameterError
from phantom_dyn.model.inertia import STANDARD_NAMES, STANDARD_UNITS, payload_body, point_mass_parameters
from phantom_dyn.model.robot import Robot

_PASSES = 2  # weights need the gains, and gains hardly need the weights: a third pass changes nothing


@dataclass(frozen=True)
class WeighedPayload:
    """A payload on the link of ``payload_frame`` (else of frame ``tip``, else on the last).

    Attributes:
        mass: Weighed [kg].
        center: Its place in the frame of the joint that moves the link [m], as a point mass; None if only the mass is
            known: then centre and inertia are estimated.
    """

    mass: float
    center: tuple[float, float, float] | None = None

    def __post_init__(self):
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise ParameterError(f"The known payload weighs {self.mass:g} kg: give a mass above 0.")
        if self.center is not None and not (len(self.center) == 3 and np.isfinite(self.center).all()):
            raise ParameterError(f"The centre of the known payload is {self.center}: give three numbers in m, or None.")


def fit_tls(
    robot: Robot,
    logs: Sequence[Log],
    effects: Sequence[EffectOnJoint] = (),
    *,
    payloads: Sequence[WeighedPayload | None] = (),
) -> Fit:
    """Base parameters of the rigid body and the effects, and the gain of every drive.

    Args:
        robot: Gives the rigid body.
        logs: At least one recording with a known payload; one without separates the payload from the last link.
        effects: What acts on the joints beside the rigid body.
        payloads: What each recording carries, None for nothing.

    Returns:
        The fit; ``others`` holds ``<joint>.drive_gain`` (true torque over recorded torque), and the unknown parameters
        of the payload.

    Raises:
        ParameterError: If there is no payload, or not one entry for each recording, or a joint is not driven.
        IdentifiabilityError: If the recordings do not determine parameters and gains.
    """
    return tls(torque_regressor(robot, logs, effects), payloads)


def tls(regressor: Regressor, payloads: Sequence[WeighedPayload | None]) -> Fit:
    """`fit_tls` on equations that are made already, the rigid body among the unknowns.

    Args:
        regressor: The equations.
        payloads: The weighed payload of each recording, None where there was none.

    Raises:
        ParameterError: If there is no payload, or not one entry for each recording, or a joint is not driven.
        IdentifiabilityError: If the recordings do not determine parameters and gains.
    """
    _check(regressor, payloads)
    base = base_of(regressor)
    rows, nv = base_rows(regressor, base), regressor.robot.nv
    known, unknown, names, units = _payload_columns(regressor, payloads)
    extra = _independent_unknowns(rows, unknown)
    X = np.concatenate([rows, unknown[:, :, list(extra)]], axis=2)
    V = regressor.measured[:, :, None] * np.eye(nv)
    # What rotors and modelled friction take is known as the payload is: it does not scale with a gain.
    known = known + (regressor.measured - regressor.y)
    size = np.sqrt(np.mean(regressor.measured**2, axis=0))
    weights = 1.0 / size
    parameters, gains = _null_vector(X, known, V, weights)
    left = V @ gains - X @ parameters - known
    for _ in range(_PASSES):
        noise = np.sqrt(np.mean(left**2, axis=0)) / np.abs(gains)
        weights = 1.0 / np.maximum(noise, 1e-9 * size)
        parameters, gains = _null_vector(X, known, V, weights)
        left = V @ gains - X @ parameters - known
    both = np.concatenate([X, -V], axis=2)
    factor = factor_of(both, weights)
    influence = influence_of(both, factor, weights)
    sigma = joint_noise(left, np.einsum("njk,njk->j", influence, both, optimize=True))
    cov, white, correlation = covariances(influence, left, sigma, regressor.starts)
    r, std = base.rank, np.sqrt(np.diag(cov))
    joints = regressor.robot.joint_names
    others = [Estimate(f"{joint}.drive_gain", float(g), float(s), "1")
              for joint, g, s in zip(joints, gains, std[-nv:], strict=True)]  # fmt: skip
    others += [Estimate(f"payload.{names[k]}", float(parameters[r + i]), float(std[r + i]), units[k])
               for i, k in enumerate(extra)]  # fmt: skip
    values = Values(
        theta=parameters[:r],
        cov=cov[:r, :r],
        cov_white=white[:r, :r],
        sigma=sigma,
        correlation=correlation,
        residual=left,
        factor=_of_parameters(factor, r),
    )
    return fit_of("tls", regressor, base, values, others=tuple(others))


def _of_parameters(factor: Float[Array, "q q"], r: int) -> Float[Array, "r r"]:
    """Factor of the first ``r`` unknowns with all others free: what is left of their columns beside those of others."""
    turned = np.concatenate([factor[:, r:], factor[:, :r]], axis=1)
    return np.asarray(np.linalg.qr(turned, mode="r"))[-r:, -r:]


def _check(regressor: Regressor, payloads: Sequence[WeighedPayload | None]) -> None:
    if len(payloads) != len(regressor.logs):
        raise ParameterError(
            f"{len(payloads)} payloads were given for {len(regressor.logs)} recordings: give one for each, None for "
            "nothing."
        )
    if not any(payloads):
        raise ParameterError(
            "Total least squares finds the gains of the drives from a payload of known mass, and no recording has "
            "one: record with a weighed mass, or use an estimator that trusts the torque, such as wls."
        )
    if not regressor.rigid_body:
        raise ParameterError("Total least squares needs the rigid body among the unknowns: use torque_regressor.")
    idle = [joint for joint, column in zip(regressor.robot.joint_names, regressor.measured.T, strict=True)
            if not column.any()]  # fmt: skip
    if idle:
        raise ParameterError(f"The torque of {', '.join(idle)} is zero, so that it has no gain: lock the joint.")


def _payload_columns(
    regressor: Regressor, payloads: Sequence[WeighedPayload | None]
) -> tuple[Float[Array, "N nv"], Float[Array, "N nv k"], tuple[str, ...], tuple[str, ...]]:
    """Torque of the payload's known parameters, and columns of the unknown ones, with names and units."""
    first = 10 * (payload_body(regressor.robot) - 1)
    body = np.concatenate([block[:, :, first : first + 10] for block in regressor.blocks()])
    known, unknown = np.zeros(regressor.y.shape), np.zeros((*regressor.y.shape, 9))
    for k, payload in enumerate(payloads):
        at = slice(regressor.starts[k], regressor.starts[k + 1])
        if payload is not None and payload.center is not None:
            known[at] = body[at] @ point_mass_parameters(payload.mass, np.array(payload.center))
        elif payload is not None:
            known[at] = payload.mass * body[at, :, 0]
            unknown[at] = body[at, :, 1:]
    return known, unknown, STANDARD_NAMES[1:], STANDARD_UNITS[1:]


def _independent_unknowns(rows: Float[Array, "N nv r"], unknown: Float[Array, "N nv k"]) -> tuple[int, ...]:
    """Which unknowns of the payload add to the base parameters of the robot."""
    r, kept = rows.shape[2], np.flatnonzero(unknown.any(axis=(0, 1)))
    stacked = np.concatenate([rows, unknown[:, :, kept]], axis=2).reshape(-1, r + len(kept))
    scaled = stacked / np.linalg.norm(stacked, axis=0)
    found: BaseParameters = base_parameters_of_matrix(scaled, [str(k) for k in range(scaled.shape[1])])
    return tuple(int(kept[k - r]) for k in found.independent if k >= r)


def _null_vector(
    X: Float[Array, "N nv r"], known: Float[Array, "N nv"], V: Float[Array, "N nv nv"], weights: Float[Array, " nv"]
) -> tuple[Float[Array, " r"], Float[Array, " nv"]]:
    """Parameters and gains: the direction of least error, scaled so that the known column counts once."""
    columns = np.concatenate([X, known[:, :, None], -V], axis=2) * weights[:, None]
    flat = columns.reshape(-1, columns.shape[2])
    norms = np.linalg.norm(flat, axis=0)
    exact = X.shape[2] + 1
    # Errors of one size in every column of the torque: weights give that; only exact columns may be scaled.
    norms[exact:] = 1.0
    R = np.asarray(np.linalg.qr(flat / norms, mode="r"))
    if np.abs(np.diag(R)[:exact]).min() < 1e-9:
        raise IdentifiabilityError(
            "The recordings do not separate the known payload from the robot: add one without it, or of more motion."
        )
    gains = np.linalg.svd(R[exact:, exact:])[2][-1]
    exact_part = np.linalg.solve(R[:exact, :exact], -R[:exact, exact:] @ gains) / norms[:exact]
    if np.abs(exact_part[-1]) < 1e-12 * np.abs(gains).max():
        raise IdentifiabilityError("The torque does not show the known payload: record a heavier one or more motion.")
    return exact_part[:-1] / exact_part[-1], gains / exact_part[-1]
